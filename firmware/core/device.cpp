#include "device.h"

namespace softrobot {
namespace {

constexpr uint32_t kMillisecond = 1000;  // µs
constexpr uint32_t kArmedForUs = 1000000;
constexpr uint32_t kLongestRampUs = 10000000;  // however slow the host wants it

}  // namespace

void Device::run(uint32_t now_us, const Measured& measured, const uint8_t* received,
                 uint16_t size) {
  const uint32_t elapsed_us = ran_ ? now_us - now_us_ : 0;
  ran_ = true;
  now_us_ = now_us;
  measure(measured);
  expire();
  react();
  move(elapsed_us);
  for (uint16_t i = 0; i < size; ++i) {
    if (decoder_.feed(received[i])) handle(decoder_.body(), decoder_.size());
  }
  supervise();
  react();
  report();
}

Outputs Device::outputs() const {
  Outputs out = {};
  out.powered = driven();
  out.state = state_;
  for (uint8_t i = 0; i < info_.n; ++i) {
    out.applied[i] = motion_.applied()[i];
    if (driven()) out.pulse_us[i] = static_cast<uint16_t>(config_.pulse(i, out.applied[i]));
  }
  return out;
}

// What a board cannot measure is nothing from here on.
void Device::measure(const Measured& measured) {
  measured_ = measured;
  for (uint8_t i = 0; i < info_.n; ++i) {
    if (!has(capability::kForce)) measured_.force[i] = 0;
  }
  for (uint8_t i = 0; i < kAdcChannels; ++i) {
    if (!has(capability::kAdc)) measured_.adc[i] = 0;
  }
  if (!has(capability::kSupply)) measured_.vbus = 0;
}

void Device::expire() {
  const uint32_t silence_us = session_.silence_us(now_us_);
  if (state_ == DeviceState::kArmed && now_us_ - armed_us_ >= kArmedForUs) {
    end(DeviceState::kDisarmed);
  }
  if (state_ == DeviceState::kRunning && silence_us >= config_.watchdog_ms * kMillisecond) {
    const int32_t silence_ms = static_cast<int32_t>(silence_us / kMillisecond);
    faults_.add(Fault::kWatchdog, 0, silence_ms, now_us_);
  }
}

void Device::move(uint32_t elapsed_us) {
  motion_.advance(info_.n, elapsed_us);
  const bool over = motion_.arrived(info_.n) || now_us_ - ramp_us_ >= kLongestRampUs;
  if (state_ == DeviceState::kRamping && over) {
    end(faults_.any() ? DeviceState::kLatched : DeviceState::kDisarmed);
  }
}

void Device::supervise() {
  if (measured_.estop) faults_.add(Fault::kEstop, 0, 1, now_us_);
  const bool alive = driven() || state_ == DeviceState::kArmed;
  if (alive && safety_.brown_out(config_, measured_)) {
    faults_.add(Fault::kBrownOut, 0, measured_.vbus, now_us_);
  }
  if (!driven()) return;
  const int16_t* applied = motion_.applied();
  motion_.freeze(safety_.check_driven(config_, measured_, applied, now_us_, faults_));
}

// Does what the faults so far ask for.
void Device::react() {
  if (!faults_.any() || state_ == DeviceState::kLatched) return;
  if (!driven() || faults_.cuts()) {
    end(DeviceState::kLatched);
  } else if (state_ == DeviceState::kRunning) {
    ramp(config_.ramp);
  }
}

void Device::ramp(uint16_t speed) {
  motion_.ramp(config_, speed);
  ramp_us_ = now_us_;
  state_ = DeviceState::kRamping;
}

void Device::end(DeviceState state) {
  motion_.cut();
  session_.close();
  state_ = state;
}

// Measured if possible, otherwise where the outputs were driven to.
const int16_t* Device::length() const {
  return has(capability::kLength) ? measured_.length : motion_.applied();
}

}  // namespace softrobot
