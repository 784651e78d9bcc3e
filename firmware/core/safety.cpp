#include "safety.h"

namespace softrobot {

uint8_t Safety::check_driven(const Config& config, const Measured& measured,
                             const int16_t* applied, uint32_t now_us, FaultLog& faults) {
  const uint16_t time = config.stall_ms;
  uint8_t stuck = 0;
  for (uint8_t i = 0; i < config.n; ++i) {
    const bool hard = force_[i].for_ms(time, pulls_too_hard(config, measured, i), now_us);
    const bool loose = slack_[i].for_ms(time, is_slack(config, measured, i), now_us);
    const int32_t lag = static_cast<int32_t>(measured.length[i]) - applied[i];
    const bool stalled = stall_[i].for_ms(time, is_stalled(config, lag), now_us);
    if (hard) faults.add(Fault::kForce, i, measured.force[i], now_us);
    if (loose) faults.add(Fault::kSlack, i, measured.force[i], now_us);
    if (stalled) faults.add(Fault::kStall, i, lag, now_us);
    if (hard || stalled) stuck = static_cast<uint8_t>(stuck | (1u << i));
  }
  for (uint8_t i = 0; i < kAdcChannels; ++i) {
    const bool bad = rail_[i].for_ms(time, rail(config, measured, i), now_us);
    if (bad) faults.add(Fault::kAdc, i, measured.adc[i], now_us);
  }
  return stuck;
}

bool Safety::brown_out(const Config& config, const Measured& measured) const {
  return has(capability::kSupply) && measured.vbus < config.vbus_min;
}

bool Safety::adc_at_rail(const Config& config, const Measured& measured) const {
  for (uint8_t i = 0; i < kAdcChannels; ++i) {
    if (rail(config, measured, i)) return true;
  }
  return false;
}

uint16_t Safety::present(const Config& config, const Measured& measured) const {
  uint16_t causes = 0;
  if (measured.estop) causes |= bit_of(Fault::kEstop);
  if (brown_out(config, measured)) causes |= bit_of(Fault::kBrownOut);
  if (adc_at_rail(config, measured)) causes |= bit_of(Fault::kAdc);
  for (uint8_t i = 0; i < config.n; ++i) {
    if (pulls_too_hard(config, measured, i)) causes |= bit_of(Fault::kForce);
  }
  return causes;
}

bool Safety::rail(const Config& config, const Measured& measured, uint8_t channel) const {
  const bool supervised = has(capability::kAdc) && (config.adc_mask >> channel & 1);
  const uint16_t value = measured.adc[channel];
  return supervised && (value < config.adc_low || value > config.adc_high);
}

bool Safety::pulls_too_hard(const Config& config, const Measured& measured, uint8_t i) const {
  const int32_t limit = config.max_force[i];
  return has(capability::kForce) && limit > 0 && measured.force[i] > limit;
}

// A limit of zero is no limit: a load cell may well show a little less than nothing.
bool Safety::is_slack(const Config& config, const Measured& measured, uint8_t i) const {
  const int32_t limit = config.min_force[i];
  return has(capability::kForce) && limit > 0 && measured.force[i] < limit;
}

bool Safety::is_stalled(const Config& config, int32_t lag) const {
  const int32_t limit = config.stall_error;
  return has(capability::kLength) && limit > 0 && (lag > limit || lag < -limit);
}

}  // namespace softrobot
