// Supervision of what the board measures. Checks of a quantity need its capability; the
// emergency stop counts on every board.
#pragma once

#include <stdint.h>

#include "board.h"
#include "faults.h"
#include "messages.h"

namespace softrobot {

// Whether something has been wrong without a break for some time.
class Lasting {
 public:
  bool for_ms(uint16_t duration, bool wrong, uint32_t now_us) {
    if (!wrong || !wrong_) since_us_ = now_us;
    wrong_ = wrong;
    return wrong && now_us - since_us_ >= duration * kMillisecond;
  }

 private:
  static constexpr uint32_t kMillisecond = 1000;  // µs

  bool wrong_ = false;
  uint32_t since_us_ = 0;
};

class Safety {
 public:
  explicit Safety(uint16_t capabilities) : capabilities_(capabilities) {}

  // Forget how long anything has lasted.
  void restart() { *this = Safety(capabilities_); }

  // Adds the faults of tendons and converter, for outputs that were driven to `applied`. Returns
  // the tendons (bits) that must not move any more: too much force, or stalled.
  uint8_t check_driven(const Config& config, const Measured& measured, const int16_t* applied,
                       uint32_t now_us, FaultLog& faults);

  bool brown_out(const Config& config, const Measured& measured) const;
  bool adc_at_rail(const Config& config, const Measured& measured) const;

  // Causes (bits of faults) that are there at this moment with the outputs off. Tendons are then
  // slack and servos idle, so that neither slack nor a stall is one.
  uint16_t present(const Config& config, const Measured& measured) const;

 private:
  bool has(uint16_t capability) const { return (capabilities_ & capability) != 0; }
  bool rail(const Config& config, const Measured& measured, uint8_t channel) const;
  bool pulls_too_hard(const Config& config, const Measured& measured, uint8_t i) const;
  bool is_slack(const Config& config, const Measured& measured, uint8_t i) const;
  bool is_stalled(const Config& config, int32_t lag) const;

  uint16_t capabilities_;
  Lasting force_[kMostTendons], slack_[kMostTendons], stall_[kMostTendons], rail_[kAdcChannels];
};

}  // namespace softrobot
