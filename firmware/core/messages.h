// What arrives from the host; names and units as in softrobot_env/hardware/protocol/messages.py.
// A constructor reads the fields of a body, after its header, which the decoder has checked.
#pragma once

#include <stdint.h>

#include "bytes.h"
#include "schema.h"

namespace softrobot {

// Answer of a handler that has nothing against a message.
constexpr Reason kAccepted = static_cast<Reason>(0);

struct Header {
  explicit Header(Reader& in) : protocol(in.u8()), type(in.u8()), seq(in.u16()) {}

  uint8_t protocol, type;
  uint16_t seq;
};

struct Hello {
  explicit Hello(Reader& in) : nonce(in.u32()), min_protocol(in.u8()), max_protocol(in.u8()) {}

  uint32_t nonce;
  uint8_t min_protocol, max_protocol;
};

struct Config {
  Config() = default;
  explicit Config(Reader& in);

  // kAccepted, or what is wrong with it on a board of `board_n` tendons.
  Reason check(uint8_t board_n) const;

  // Pulse of a servo in microseconds when `length` is pulled in.
  int32_t pulse(uint8_t tendon, int16_t length) const;
  int32_t fine_pulse(uint8_t tendon, int16_t length) const;  // 0.0001 µs

  // Length pulled in that stands for such a pulse, or the outermost number beyond.
  int16_t length(uint8_t tendon, int32_t fine_pulse) const;

  uint8_t n;
  uint16_t watchdog_ms, state_delay_us, free_run_ms, ramp, arm_window, stall_error, stall_ms;
  uint8_t adc_mask;
  uint16_t adc_low, adc_high, vbus_min;
  uint16_t center_us[kMostTendons];
  int16_t gain[kMostTendons], minimum[kMostTendons], maximum[kMostTendons];
  uint16_t slew[kMostTendons];
  int16_t rest[kMostTendons];
  uint16_t max_force[kMostTendons], min_force[kMostTendons];

 private:
  Reason check_tendon(uint8_t tendon) const;
};

struct Arm {
  explicit Arm(Reader& in) : session(in.u16()), config_crc(in.u32()) {}

  uint16_t session;
  uint32_t config_crc;
};

struct Setpoint {
  explicit Setpoint(Reader& in);

  uint16_t session;
  uint32_t t_host;
  uint16_t ttl_ms;
  uint8_t mode, n;
  int16_t target[kMostTendons];
};

struct Stop {
  explicit Stop(Reader& in) : session(in.u16()), ramp(in.u16()) {}
  explicit Stop(uint16_t disarmed) : session(disarmed), ramp(0) {}  // what Disarm means

  uint16_t session, ramp;
};

}  // namespace softrobot
