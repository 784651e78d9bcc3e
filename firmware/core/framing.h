// Frames on the wire: 00 | COBS(body | CRC-32) | 00. See softrobot_env/hardware/protocol/messages.py.
#pragma once

#include <stdint.h>

#include "bytes.h"
#include "schema.h"

namespace softrobot {

// As zlib's crc32(data, seed).
uint32_t crc32(const uint8_t* data, uint8_t size, uint32_t seed);

// What the checksum of a message type starts from.
uint32_t seed_of(uint8_t type);

// Bodies out of a stream of bytes, in bounded memory whatever arrives.
class Decoder {
 public:
  // True if this byte completes a valid frame: body() and size() then hold until the next call.
  bool feed(uint8_t byte);

  const uint8_t* body() const { return buffer_; }
  uint8_t size() const { return size_; }
  uint16_t crc_errors() const { return crc_errors_; }
  uint16_t frame_errors() const { return frame_errors_; }

 private:
  bool finish();
  bool valid();
  bool unstuff();

  uint8_t buffer_[kLongestFrame];
  uint8_t length_ = 0;  // received since the last zero
  uint8_t size_ = 0;    // of the body
  bool overlong_ = false;
  uint16_t crc_errors_ = 0, frame_errors_ = 0;  // saturate
};

// Bytes to be sent. A frame enters as a whole or not at all.
class SendQueue {
 public:
  // False if it would leave less than `spare` bytes; the queue then is as before.
  bool push(Body body, uint16_t spare);

  // False if the queue is empty.
  bool pop(uint8_t& byte);

 private:
  static constexpr uint16_t kRoom = 256;

  void put(uint8_t byte);

  uint8_t ring_[kRoom];
  uint16_t first_ = 0, size_ = 0;
};

}  // namespace softrobot
