#include "motion.h"

namespace softrobot {
namespace {

constexpr uint32_t kMillion = 1000000;

// A main loop that was stuck does not catch up with a jump; the product with a speed of 16 bits
// fits into 32.
constexpr uint32_t kLongestStepUs = 50000;

int16_t limited(int16_t value, int16_t low, int16_t high) {
  return value < low ? low : value > high ? high : value;
}

}  // namespace

void Motion::start(const Config& config, const int16_t* present) {
  for (uint8_t i = 0; i < config.n; ++i) {
    applied_[i] = limited(present[i], config.minimum[i], config.maximum[i]);
    goal_[i] = applied_[i];
    remainder_[i] = 0;
  }
  frozen_ = 0;
  powered_ = moved_ = true;
}

void Motion::follow(const Config& config, const int16_t* target) {
  for (uint8_t i = 0; i < config.n; ++i) {
    goal_[i] = target[i];
    speed_[i] = config.slew[i];
  }
}

void Motion::ramp(const Config& config, uint16_t ramp) {
  for (uint8_t i = 0; i < config.n; ++i) {
    goal_[i] = config.rest[i];
    speed_[i] = ramp < config.slew[i] ? ramp : config.slew[i];
  }
}

void Motion::restate(const Config& before, const Config& after) {
  for (uint8_t i = 0; i < after.n; ++i) {
    const int32_t last = before.fine_pulse(i, applied_[i]);
    applied_[i] = moved_ ? after.length(i, last) : after.rest[i];
  }
}

void Motion::advance(uint8_t n, uint32_t elapsed_us) {
  if (!powered_) return;
  if (elapsed_us > kLongestStepUs) elapsed_us = kLongestStepUs;
  for (uint8_t i = 0; i < n; ++i) step(i, elapsed_us);
}

bool Motion::arrived(uint8_t n) const {
  for (uint8_t i = 0; i < n; ++i) {
    if (!waits(i)) return false;
  }
  return true;
}

void Motion::step(uint8_t i, uint32_t elapsed_us) {
  if (waits(i)) {
    remainder_[i] = 0;
    return;
  }
  const uint32_t way = remainder_[i] + speed_[i] * elapsed_us;
  const int32_t most = static_cast<int32_t>(way / kMillion);
  remainder_[i] = way % kMillion;
  const int32_t gap = static_cast<int32_t>(goal_[i]) - applied_[i];
  const int32_t move = gap > most ? most : gap < -most ? -most : gap;
  applied_[i] = static_cast<int16_t>(applied_[i] + move);
}

}  // namespace softrobot
