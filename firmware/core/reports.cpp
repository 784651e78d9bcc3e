#include "device.h"

namespace softrobot {
namespace {

constexpr uint32_t kMillisecond = 1000;  // µs
constexpr uint16_t kUnconfiguredPeriodMs = 50;
constexpr uint32_t kFaultPeriodUs = 200000;
constexpr uint16_t kFirmware = 0x0100;  // major << 8 | minor

// What states leave free in the queue, so that answers and faults find room.
constexpr uint16_t kSpare = 96;

}  // namespace

// Sends what is due. What finds no room stays due, so that the newest numbers go out later.
void Device::report() {
  const bool fault_due = !fault_told_ || now_us_ - fault_us_ >= kFaultPeriodUs;
  if (faults_.any() && fault_due && send_fault()) {
    fault_told_ = true;
    fault_us_ = now_us_;
  }
  if (state_due() && send_state()) {
    echo_waits_ = false;
    remarks_ = 0;
    state_us_ = now_us_;
  }
}

bool Device::state_due() const {
  const uint16_t period_ms = configured_ ? config_.free_run_ms : kUnconfiguredPeriodMs;
  const bool echoes = echo_waits_ && static_cast<int32_t>(now_us_ - echo_us_) >= 0;
  return echoes || now_us_ - state_us_ >= period_ms * kMillisecond;
}

Body Device::begin(Type type) {
  Body body;
  body.u8(kProtocol);
  body.u8(static_cast<uint8_t>(type));
  body.u16(seq_++);
  return body;
}

void Device::send_hello_ack(uint32_t nonce) {
  Body body = begin(Type::kHelloAck);
  body.u32(nonce);
  body.u32(info_.boot_id);
  body.u16(kFirmware);
  body.u8(kProtocol);
  body.u8(kProtocol);
  body.u32(kSchema);
  body.u8(info_.n);
  body.u16(info_.capabilities);
  body.u8(static_cast<uint8_t>(info_.reset_cause));
  queue_.push(body, 0);
}

void Device::send_config_ack() {
  Body body = begin(Type::kConfigAck);
  body.u32(config_crc_);
  queue_.push(body, 0);
}

void Device::send_pong(uint32_t t_host) {
  Body body = begin(Type::kPong);
  body.u32(t_host);
  body.u32(now_us_);
  queue_.push(body, 0);
}

void Device::send_nack(const Header& about, Reason reason) {
  Body body = begin(Type::kNack);
  body.u8(about.type);
  body.u16(about.seq);
  body.u8(static_cast<uint8_t>(reason));
  queue_.push(body, 0);
}

bool Device::send_fault() {
  Body body = begin(Type::kFaultReport);
  body.u8(static_cast<uint8_t>(faults_.first()));
  body.u8(faults_.channel());
  body.u32(static_cast<uint32_t>(faults_.value()));
  body.u32(faults_.t_us());
  return queue_.push(body, 0);
}

bool Device::send_state() {
  Body body = begin(Type::kState);
  body.u32(now_us_);
  body.u16(session_.last_seq());
  body.u32(session_.t_host_echo());
  body.u8(static_cast<uint8_t>(state_));
  body.u8(info_.n);
  body.u16(faults_.bits());
  body.u16(warnings());
  body.u16(session_.id());
  body.i16s(motion_.applied(), info_.n);
  body.i16s(length(), info_.n);
  body.i16s(measured_.force, info_.n);
  for (uint8_t i = 0; i < kAdcChannels; ++i) body.u16(measured_.adc[i]);
  body.u16(measured_.vbus);
  body.u16(decoder_.crc_errors());
  body.u16(decoder_.frame_errors());
  return queue_.push(body, kSpare);
}

uint16_t Device::warnings() const {
  uint16_t bits = remarks_;
  if (driven() && !motion_.arrived(info_.n)) bits |= warning::kSlewing;
  if (configured_ && safety_.adc_at_rail(config_, measured_)) bits |= warning::kAdcRail;
  return bits;
}

}  // namespace softrobot
