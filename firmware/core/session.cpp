#include "session.h"

namespace softrobot {
namespace {

// The least offset rises by 1/128 of the time: the drift of a ceramic resonator, 0.5 %, is no age.
constexpr uint32_t kDrift = 128;

constexpr uint32_t kMillisecond = 1000;  // µs

}  // namespace

void Session::open(uint16_t id) {
  *this = Session();
  id_ = id;
}

Reason Session::check(const Setpoint& setpoint, uint16_t seq, uint32_t now_us) {
  const bool newer = static_cast<int16_t>(static_cast<uint16_t>(seq - last_seq_)) > 0;
  if (any_accepted_ && !newer) return Reason::kSequence;
  const uint32_t age = age_us(setpoint.t_host, now_us);
  return age > setpoint.ttl_ms * kMillisecond ? Reason::kLate : kAccepted;
}

void Session::accept(const Setpoint& setpoint, uint16_t seq, uint32_t now_us) {
  any_accepted_ = true;
  last_seq_ = seq;
  t_host_echo_ = setpoint.t_host;
  accepted_us_ = now_us;
}

uint32_t Session::age_us(uint32_t t_host, uint32_t now_us) {
  const uint32_t offset = now_us - t_host;
  if (any_offset_) offset_ += (now_us - offset_us_) / kDrift;
  const int32_t age = static_cast<int32_t>(offset - offset_);
  if (!any_offset_ || age < 0) offset_ = offset;
  any_offset_ = true;
  offset_us_ = now_us;
  return offset - offset_;
}

}  // namespace softrobot
