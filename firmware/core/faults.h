// Which faults there were: the first cause with its particulars, the later ones as bits.
#pragma once

#include <stdint.h>

#include "schema.h"

namespace softrobot {

constexpr uint16_t bit_of(Fault fault) {
  return static_cast<uint16_t>(1u << static_cast<uint8_t>(fault));
}

class FaultLog {
 public:
  void add(Fault fault, uint8_t channel, int32_t value, uint32_t now_us) {
    if (bits_ == 0) {
      first_ = fault;
      channel_ = channel;
      value_ = value;
      t_us_ = now_us;
    }
    bits_ = static_cast<uint16_t>(bits_ | bit_of(fault));
  }
  void clear() { *this = FaultLog(); }

  bool any() const { return bits_ != 0; }
  uint16_t bits() const { return bits_; }

  // Whether the outputs must go off without a ramp.
  bool cuts() const { return (bits_ & (bit_of(Fault::kEstop) | bit_of(Fault::kBrownOut))) != 0; }

  // The first cause. Units as in messages.h: value in 0.01 N, 0.01 mm, mV, counts, or ms.
  Fault first() const { return first_; }
  uint8_t channel() const { return channel_; }
  int32_t value() const { return value_; }
  uint32_t t_us() const { return t_us_; }

 private:
  uint16_t bits_ = 0;
  Fault first_ = Fault::kNone;
  uint8_t channel_ = 0;
  int32_t value_ = 0;
  uint32_t t_us_ = 0;
};

}  // namespace softrobot
