// The functions of core/board.h on an ATmega328P or ATmega2560.
#include "../core/board.h"

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>
#include <util/atomic.h>

#include "converter.h"
#include "serial.h"
#include "timer.h"
#include "wiring.h"

namespace softrobot {
namespace {

uint8_t reset_flags __attribute__((section(".noinit")));

uint32_t* const kBootIdAddress = nullptr;  // the first word of the EEPROM

// Before main(): after a reset by the watchdog it still runs, and would soon bite again.
extern "C" void save_reset_flags() __attribute__((naked, used, section(".init3")));
void save_reset_flags() {
  reset_flags = MCUSR;
  MCUSR = 0;
  wdt_disable();
}

Reset reset_cause() {
  if (reset_flags & _BV(WDRF)) return Reset::kWatchdog;
  if (reset_flags & _BV(PORF)) return Reset::kPowerOn;  // voltage rises: brown-out is set as well
  if (reset_flags & _BV(BORF)) return Reset::kBrownOut;
  return reset_flags & _BV(EXTRF) ? Reset::kExternal : Reset::kPowerOn;
}

uint32_t next_boot_id() {
  const uint32_t id = eeprom_read_dword(kBootIdAddress) + 1;
  eeprom_update_dword(kBootIdAddress, id);
  return id;
}

bool calibrated() {
  for (const wiring::Potentiometer& pot : wiring::kPotentiometers) {
    if (pot.gain == 0) return false;
  }
  return true;
}

// Of a servo's horn, from its potentiometer.
int16_t length(uint8_t i) {
  const wiring::Potentiometer& pot = wiring::kPotentiometers[i];
  const uint16_t counts = converter::read(static_cast<uint8_t>(wiring::kFirstPotentiometer + i));
  const int32_t way = (static_cast<int32_t>(counts) - pot.zero) * pot.gain / 1000;
  return static_cast<int16_t>(way < INT16_MIN ? INT16_MIN : way > INT16_MAX ? INT16_MAX : way);
}

uint16_t supply_mv() {
  const uint32_t counts = converter::read(wiring::kSupplyChannel);
  return static_cast<uint16_t>(counts * wiring::kSupplyFullMv / 4096);
}

// Without an interrupt in between: the timer's writes the servos' pins, which may be on this port.
void set_supply(bool on) {
  const uint8_t bit = static_cast<uint8_t>(_BV(wiring::kSupplyPin));
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    SUPPLY_PORT = static_cast<uint8_t>(on ? SUPPLY_PORT | bit : SUPPLY_PORT & ~bit);
  }
}

}  // namespace

namespace board {

void begin() {
  set_supply(false);
  SUPPLY_DDR = static_cast<uint8_t>(SUPPLY_DDR | _BV(wiring::kSupplyPin));
  ESTOP_PORT = static_cast<uint8_t>(ESTOP_PORT | _BV(wiring::kEstopPin));  // pull-up
  timer::begin();
  serial::begin();
  converter::begin();
  wdt_enable(WDTO_120MS);
  sei();
}

BoardInfo info() {
  const uint16_t lengths = calibrated() ? capability::kLength : 0;
  const uint16_t others = capability::kAdc | capability::kSupply | capability::kEstopSwitch;
  const uint16_t all = static_cast<uint16_t>(lengths | others);
  return {wiring::kTendons, next_boot_id(), reset_cause(), all};
}

uint32_t now_us() { return timer::now_us(); }

void measure(Measured& measured) {
  for (uint8_t i = 0; i < wiring::kTendons; ++i) measured.length[i] = length(i);
  for (uint8_t i = 0; i < kAdcChannels; ++i) measured.adc[i] = converter::read(i);
  measured.vbus = supply_mv();
  measured.estop = bit_is_set(ESTOP_PIN, wiring::kEstopPin);  // the switch opens to stop
}

void apply(const Outputs& outputs) {
  set_supply(outputs.powered);
  if (outputs.powered) {
    timer::set_pulses(outputs.pulse_us);
  } else {
    timer::stop_pulses();
  }
}

uint8_t read(uint8_t* data, uint8_t room) { return serial::read(data, room); }

bool can_write() { return serial::can_write(); }

void write(uint8_t byte) { serial::write(byte); }

void feed_watchdog() { wdt_reset(); }

}  // namespace board
}  // namespace softrobot
