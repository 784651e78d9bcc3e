#include "converter.h"

#include <avr/io.h>

#include "wiring.h"

namespace softrobot {
namespace {

constexpr uint8_t kStartSingleEnded = 0x06;

uint8_t bit(uint8_t pin) { return static_cast<uint8_t>(_BV(pin)); }

void select() { PORTB = static_cast<uint8_t>(PORTB & ~bit(wiring::kSelectPin)); }

void release() { PORTB = static_cast<uint8_t>(PORTB | bit(wiring::kSelectPin)); }

uint8_t exchange(uint8_t byte) {
  SPDR = byte;
  loop_until_bit_is_set(SPSR, SPIF);
  return SPDR;
}

}  // namespace

namespace converter {

void begin() {
  release();
  const uint8_t driven =
      bit(wiring::kSelectPin) | bit(wiring::kClockPin) | bit(wiring::kToConverterPin);
  DDRB = static_cast<uint8_t>(DDRB | driven);
  SPCR = static_cast<uint8_t>(_BV(SPE) | _BV(MSTR) | _BV(SPR0));  // mode 0, 1 MHz
}

uint16_t read(uint8_t channel) {
  select();
  exchange(static_cast<uint8_t>(kStartSingleEnded | (channel >> 2)));
  const uint8_t high = exchange(static_cast<uint8_t>(channel << 6)) & 0x0F;
  const uint8_t low = exchange(0);
  release();
  return static_cast<uint16_t>((static_cast<uint16_t>(high) << 8) | low);
}

}  // namespace converter
}  // namespace softrobot
