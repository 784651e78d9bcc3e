#include "timer.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "wiring.h"

#if F_CPU != 16000000UL
#error "the clock counts half microseconds: F_CPU must be 16 MHz"
#endif

namespace softrobot {
namespace {

constexpr uint16_t kPeriodTicks = 40000;  // 20 ms
constexpr uint16_t kGapTicks = 400;       // instead of a pulse that is off

constexpr uint16_t kEntryTicks = 8;       // from a compare match to the fall of the pin (simavr)

volatile uint32_t overflows = 0;
volatile uint16_t widths[wiring::kTendons] = {};  // ticks
uint8_t slot = wiring::kTendons;                  // servo whose pulse is under way; last: pause
uint16_t period_start = 0;

void lower(uint8_t servo) {
  SERVO_PORT = static_cast<uint8_t>(SERVO_PORT & ~wiring::kServoMasks[servo]);
}

// Raises the pin of a servo; returns when it is the next one's turn.
uint16_t raise(uint8_t servo) {
  const uint16_t width = widths[servo];
  if (width == 0) return static_cast<uint16_t>(TCNT1 + kGapTicks);
  SERVO_PORT = static_cast<uint8_t>(SERVO_PORT | wiring::kServoMasks[servo]);
  return static_cast<uint16_t>(TCNT1 + width - kEntryTicks);
}

}  // namespace

ISR(TIMER1_OVF_vect) { ++overflows; }

// One pulse after the other, then a pause until the period is over.
ISR(TIMER1_COMPA_vect) {
  if (slot < wiring::kTendons) {
    lower(slot);
    ++slot;
  } else {
    slot = 0;
    period_start = OCR1A;
  }
  if (slot < wiring::kTendons) {
    OCR1A = raise(slot);
  } else {
    OCR1A = static_cast<uint16_t>(period_start + kPeriodTicks);
  }
}

namespace timer {

void begin() {
  for (uint8_t i = 0; i < wiring::kTendons; ++i) {
    lower(i);
    SERVO_DDR = static_cast<uint8_t>(SERVO_DDR | wiring::kServoMasks[i]);
  }
  TCCR1A = 0;
  TCCR1B = _BV(CS11);  // a tick every 8 cycles, half a microsecond
  OCR1A = kPeriodTicks;
  TIMSK1 = static_cast<uint8_t>(_BV(OCIE1A) | _BV(TOIE1));
}

uint32_t now_us() {
  uint32_t high;
  uint16_t ticks;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    ticks = TCNT1;
    high = overflows;
    const bool pending = (TIFR1 & _BV(TOV1)) != 0;
    if (pending && ticks < 0x8000) ++high;
  }
  return (high << 15) | (ticks >> 1);
}

void set_pulses(const uint16_t* pulse_us) {
  for (uint8_t i = 0; i < wiring::kTendons; ++i) {
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { widths[i] = static_cast<uint16_t>(2 * pulse_us[i]); }
  }
}

void stop_pulses() {
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    for (uint8_t i = 0; i < wiring::kTendons; ++i) {
      widths[i] = 0;
      lower(i);
    }
  }
}

}  // namespace timer
}  // namespace softrobot
