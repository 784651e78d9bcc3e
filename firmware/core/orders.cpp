#include "device.h"

namespace softrobot {
namespace {

constexpr uint8_t kHeaderSize = 4;

int32_t distance(int16_t a, int16_t b) {
  const int32_t difference = static_cast<int32_t>(a) - b;
  return difference < 0 ? -difference : difference;
}

}  // namespace

void Device::handle(const uint8_t* body, uint8_t size) {
  Reader in(body);
  const Header header(in);
  if (header.type >= static_cast<uint8_t>(Type::kHelloAck)) return;  // its own, on a line with echo
  const uint32_t crc = crc32(body + kHeaderSize, static_cast<uint8_t>(size - kHeaderSize), 0);
  const Reason reason = obey(header, in, crc);
  if (reason != kAccepted) send_nack(header, reason);
}

// A host that has not introduced itself can do nothing but that, and stop everything.
Reason Device::obey(const Header& header, Reader in, uint32_t fields_crc) {
  const Type type = static_cast<Type>(header.type);
  if (type == Type::kHello) return hello(Hello(in));
  if (type == Type::kEStop) return emergency_stop();
  if (!greeted_) return Reason::kProtocol;
  switch (type) {
    case Type::kConfig: return configure(Config(in), fields_crc);
    case Type::kArm: return arm(Arm(in));
    case Type::kSetpoint: return setpoint(Setpoint(in), header.seq);
    case Type::kPing: return ping(in.u32());
    case Type::kStop: return stop(Stop(in));
    case Type::kDisarm: return stop(Stop(in.u16()));
    default: return clear(in.u8());
  }
}

Reason Device::hello(const Hello& hello) {
  greeted_ = hello.min_protocol <= kProtocol && kProtocol <= hello.max_protocol;
  configured_ = false;
  if (state_ == DeviceState::kRunning) ramp(config_.ramp);
  if (state_ == DeviceState::kArmed) end(DeviceState::kDisarmed);
  session_.close();
  send_hello_ack(hello.nonce);
  return kAccepted;
}

Reason Device::configure(const Config& config, uint32_t crc) {
  const bool at_rest = state_ == DeviceState::kDisarmed || state_ == DeviceState::kLatched;
  if (!at_rest) return Reason::kState;
  const Reason reason = config.check(info_.n);
  if (reason != kAccepted) return reason;
  motion_.restate(config_, config);
  config_ = config;
  config_crc_ = crc;
  configured_ = true;
  send_config_ack();
  return kAccepted;
}

Reason Device::arm(const Arm& arm) {
  if (state_ != DeviceState::kDisarmed) return Reason::kState;
  if (!configured_ || arm.config_crc != config_crc_) return Reason::kConfig;
  if (arm.session == 0) return Reason::kSession;
  if (safety_.present(config_, measured_) != 0) return Reason::kFault;
  session_.open(arm.session);
  armed_us_ = now_us_;
  state_ = DeviceState::kArmed;
  return kAccepted;
}

Reason Device::setpoint(const Setpoint& setpoint, uint16_t seq) {
  const Reason reason = check(setpoint, seq);
  if (reason == Reason::kLate) remarks_ |= warning::kLateSetpoint;
  if (reason == Reason::kSequence) remarks_ |= warning::kOldSequence;
  if (reason != kAccepted) return reason;
  if (state_ == DeviceState::kArmed) {
    motion_.start(config_, length());
    safety_.restart();
    state_ = DeviceState::kRunning;
  }
  motion_.follow(config_, setpoint.target);
  session_.accept(setpoint, seq, now_us_);
  if (!echo_waits_) echo_us_ = now_us_ + config_.state_delay_us;
  echo_waits_ = true;
  return kAccepted;
}

Reason Device::check(const Setpoint& setpoint, uint16_t seq) {
  const bool armed = state_ == DeviceState::kArmed;
  if (!armed && state_ != DeviceState::kRunning) return Reason::kState;
  if (!session_.is(setpoint.session)) return Reason::kSession;
  if (setpoint.mode != kModeLength) return Reason::kMode;
  if (setpoint.n != info_.n) return Reason::kCount;
  const Reason staleness = session_.check(setpoint, seq, now_us_);
  if (staleness != kAccepted) return staleness;
  if (!in_range(setpoint)) return Reason::kRange;
  return armed && !near(setpoint) ? Reason::kFar : kAccepted;
}

bool Device::in_range(const Setpoint& setpoint) const {
  for (uint8_t i = 0; i < info_.n; ++i) {
    const int16_t target = setpoint.target[i];
    if (target < config_.minimum[i] || target > config_.maximum[i]) return false;
  }
  return true;
}

bool Device::near(const Setpoint& setpoint) const {
  for (uint8_t i = 0; i < info_.n; ++i) {
    if (distance(setpoint.target[i], length()[i]) > config_.arm_window) return false;
  }
  return true;
}

Reason Device::ping(uint32_t t_host) {
  send_pong(t_host);
  return kAccepted;
}

Reason Device::stop(const Stop& stop) {
  if (!session_.is(stop.session)) return Reason::kSession;
  if (state_ == DeviceState::kArmed) end(DeviceState::kDisarmed);
  if (state_ == DeviceState::kRunning) ramp(stop.ramp > 0 ? stop.ramp : config_.ramp);
  return kAccepted;
}

Reason Device::emergency_stop() {
  faults_.add(Fault::kEstop, 0, 0, now_us_);
  react();
  return kAccepted;
}

Reason Device::clear(uint8_t fault) {
  if (state_ != DeviceState::kLatched) return Reason::kState;
  if (fault != static_cast<uint8_t>(faults_.first())) return Reason::kFault;
  if ((safety_.present(config_, measured_) & faults_.bits()) != 0) return Reason::kFault;
  faults_.clear();
  fault_told_ = false;
  state_ = DeviceState::kDisarmed;
  return kAccepted;
}

}  // namespace softrobot
