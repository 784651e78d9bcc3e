// One session: which set-points are fresh, and when the last one came.
#pragma once

#include <stdint.h>

#include "messages.h"

namespace softrobot {

class Session {
 public:
  void open(uint16_t id);
  void close() { id_ = 0; }

  // 0 while there is none.
  uint16_t id() const { return id_; }
  bool is(uint16_t id) const { return id_ != 0 && id_ == id; }

  // kAccepted, or why a set-point that arrives now is not fresh.
  Reason check(const Setpoint& setpoint, uint16_t seq, uint32_t now_us);

  void accept(const Setpoint& setpoint, uint16_t seq, uint32_t now_us);

  // Time since the last accepted set-point.
  uint32_t silence_us(uint32_t now_us) const { return now_us - accepted_us_; }
  uint16_t last_seq() const { return last_seq_; }
  uint32_t t_host_echo() const { return t_host_echo_; }

 private:
  uint32_t age_us(uint32_t t_host, uint32_t now_us);

  uint16_t id_ = 0, last_seq_ = 0;
  uint32_t t_host_echo_ = 0, accepted_us_ = 0;
  bool any_accepted_ = false, any_offset_ = false;
  uint32_t offset_ = 0;     // least of device clock minus host clock
  uint32_t offset_us_ = 0;  // when that was
};

}  // namespace softrobot
