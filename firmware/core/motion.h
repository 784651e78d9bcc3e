// Where the outputs are and where they go: the only place that moves them.
#pragma once

#include <stdint.h>

#include "messages.h"

namespace softrobot {

class Motion {
 public:
  // Outputs on at the position `present`, or at the limit beside it.
  void start(const Config& config, const int16_t* present);

  // Go to `target` with the configured slew rates.
  void follow(const Config& config, const int16_t* target);

  // Go to the rest position with the speed `ramp`, no tendon faster than its slew rate.
  void ramp(const Config& config, uint16_t ramp);

  // These tendons (bits) stay where they are from now on.
  void freeze(uint8_t tendons) { frozen_ |= tendons; }

  // Outputs off at once.
  void cut() { powered_ = false; }

  // With the outputs off, from now on lengths of the configuration `after`: those of the last
  // pulses, which had been lengths of `before`; the rest position if nothing has moved yet.
  void restate(const Config& before, const Config& after);

  // Moves on by this time.
  void advance(uint8_t n, uint32_t elapsed_us);

  bool powered() const { return powered_; }
  bool arrived(uint8_t n) const;
  const int16_t* applied() const { return applied_; }

 private:
  bool waits(uint8_t i) const { return applied_[i] == goal_[i] || (frozen_ >> i & 1); }
  void step(uint8_t i, uint32_t elapsed_us);

  bool powered_ = false, moved_ = false;
  uint8_t frozen_ = 0;
  int16_t applied_[kMostTendons] = {}, goal_[kMostTendons] = {};
  uint16_t speed_[kMostTendons] = {};
  uint32_t remainder_[kMostTendons] = {};  // of a step, in millionths of 0.01 mm
};

}  // namespace softrobot
