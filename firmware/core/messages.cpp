#include "messages.h"

namespace softrobot {
namespace {

constexpr uint16_t kShortestWatchdogMs = 20, kLongestWatchdogMs = 1000;
constexpr int32_t kShortestPulseUs = 400, kLongestPulseUs = 2600;
constexpr int32_t kGainScale = 10000;  // 0.01 µs per mm, times 0.01 mm

// Of whole numbers; halves away from zero.
int32_t quotient(int32_t value, int32_t divisor) {
  const int32_t half = (value < 0) == (divisor < 0) ? divisor / 2 : -divisor / 2;
  return (value + half) / divisor;
}

bool inside(int32_t value, int32_t low, int32_t high) { return low <= value && value <= high; }

bool possible(int32_t pulse) { return inside(pulse, kShortestPulseUs, kLongestPulseUs); }

}  // namespace

Config::Config(Reader& in)
    : n(in.u8()),
      watchdog_ms(in.u16()),
      state_delay_us(in.u16()),
      free_run_ms(in.u16()),
      ramp(in.u16()),
      arm_window(in.u16()),
      stall_error(in.u16()),
      stall_ms(in.u16()),
      adc_mask(in.u8()),
      adc_low(in.u16()),
      adc_high(in.u16()),
      vbus_min(in.u16()) {
  in.u16s(center_us, n);
  in.i16s(gain, n);
  in.i16s(minimum, n);
  in.i16s(maximum, n);
  in.u16s(slew, n);
  in.i16s(rest, n);
  in.u16s(max_force, n);
  in.u16s(min_force, n);
}

Reason Config::check(uint8_t board_n) const {
  if (n != board_n) return Reason::kCount;
  if (ramp == 0 || free_run_ms == 0) return Reason::kConfig;
  if (!inside(watchdog_ms, kShortestWatchdogMs, kLongestWatchdogMs)) return Reason::kRange;
  for (uint8_t i = 0; i < n; ++i) {
    const Reason reason = check_tendon(i);
    if (reason != kAccepted) return reason;
  }
  return kAccepted;
}

Reason Config::check_tendon(uint8_t i) const {
  if (gain[i] == 0 || slew[i] == 0) return Reason::kConfig;
  if (!inside(rest[i], minimum[i], maximum[i])) return Reason::kConfig;
  const bool reachable = possible(pulse(i, minimum[i])) && possible(pulse(i, maximum[i]));
  return reachable ? kAccepted : Reason::kRange;
}

int32_t Config::pulse(uint8_t tendon, int16_t length) const {
  return center_us[tendon] + quotient(static_cast<int32_t>(gain[tendon]) * length, kGainScale);
}

// Any center, gain and length fit.
int32_t Config::fine_pulse(uint8_t tendon, int16_t length) const {
  return center_us[tendon] * kGainScale + static_cast<int32_t>(gain[tendon]) * length;
}

int16_t Config::length(uint8_t tendon, int32_t fine_pulse) const {
  const int32_t way = quotient(fine_pulse - center_us[tendon] * kGainScale, gain[tendon]);
  return static_cast<int16_t>(way < INT16_MIN ? INT16_MIN : way > INT16_MAX ? INT16_MAX : way);
}

Setpoint::Setpoint(Reader& in)
    : session(in.u16()), t_host(in.u32()), ttl_ms(in.u16()), mode(in.u8()), n(in.u8()) {
  in.i16s(target, n);
}

}  // namespace softrobot
