// Little-endian numbers in and out of bytes.
#pragma once

#include <stdint.h>

namespace softrobot {

// Reads from a body whose length was checked against its layout.
class Reader {
 public:
  explicit Reader(const uint8_t* at) : at_(at) {}

  uint8_t u8() { return *at_++; }
  uint16_t u16() {
    const uint8_t low = u8();
    return static_cast<uint16_t>(low | (static_cast<uint16_t>(u8()) << 8));
  }
  uint32_t u32() {
    const uint16_t low = u16();
    return low | (static_cast<uint32_t>(u16()) << 16);
  }
  int16_t i16() { return static_cast<int16_t>(u16()); }

  void u16s(uint16_t* values, uint8_t n) {
    for (uint8_t i = 0; i < n; ++i) values[i] = u16();
  }
  void i16s(int16_t* values, uint8_t n) {
    for (uint8_t i = 0; i < n; ++i) values[i] = i16();
  }

 private:
  const uint8_t* at_;
};

// A body that grows field by field. What does not fit is left out, which the receiver sees as a
// wrong length; no message of this firmware is that long.
class Body {
 public:
  static constexpr uint8_t kRoom = 76;  // a State of six tendons and its checksum

  uint8_t size() const { return size_; }
  uint8_t operator[](uint8_t i) const { return data_[i]; }
  const uint8_t* data() const { return data_; }

  void u8(uint8_t value) {
    if (size_ < kRoom) data_[size_++] = value;
  }
  void u16(uint16_t value) {
    u8(static_cast<uint8_t>(value));
    u8(static_cast<uint8_t>(value >> 8));
  }
  void u32(uint32_t value) {
    u16(static_cast<uint16_t>(value));
    u16(static_cast<uint16_t>(value >> 16));
  }
  void i16s(const int16_t* values, uint8_t n) {
    for (uint8_t i = 0; i < n; ++i) u16(static_cast<uint16_t>(values[i]));
  }

 private:
  uint8_t data_[kRoom];
  uint8_t size_ = 0;
};

}  // namespace softrobot
