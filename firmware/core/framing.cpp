#include "framing.h"

namespace softrobot {
namespace {

constexpr uint8_t kTypeAt = 1;
constexpr uint8_t kHeaderSize = 4;
constexpr uint8_t kChecksumSize = 4;
constexpr uint8_t kOverhead = 3;  // two zeros and the first code of COBS

static_assert(Body::kRoom < 254, "longer runs need a second code of COBS");

void count(uint16_t& errors) {
  if (errors < 0xFFFF) ++errors;
}

// Whether a body has a known type, this protocol, and the length that its type asks for.
bool well_formed(const uint8_t* body, uint8_t size) {
  Layout layout;
  const uint8_t type = body[kTypeAt];
  if (size < kHeaderSize || !layout_of(type, layout)) return false;
  if (body[0] != kProtocol && seed_of(type) != 0) return false;
  if (layout.n_at == 0) return size == layout.fixed;
  if (layout.n_at >= size || body[layout.n_at] > kMostTendons) return false;
  return size == layout.fixed + body[layout.n_at] * layout.per_tendon;
}

}  // namespace

uint32_t crc32(const uint8_t* data, uint8_t size, uint32_t seed) {
  uint32_t crc = ~seed;
  for (uint8_t i = 0; i < size; ++i) {
    crc ^= data[i];
    for (uint8_t bit = 0; bit < 8; ++bit) crc = (crc & 1) ? (crc >> 1) ^ 0xEDB88320u : crc >> 1;
  }
  return ~crc;
}

uint32_t seed_of(uint8_t type) {
  const bool introduces =
      type == static_cast<uint8_t>(Type::kHello) || type == static_cast<uint8_t>(Type::kHelloAck);
  return introduces ? 0 : kSchema;
}

bool Decoder::feed(uint8_t byte) {
  if (byte == 0) return finish();
  if (length_ == kLongestFrame) {
    overlong_ = true;
  } else {
    buffer_[length_++] = byte;
  }
  return false;
}

bool Decoder::finish() {
  const bool anything = length_ > 0;
  const bool good = anything && valid();
  length_ = 0;
  overlong_ = false;
  return good;
}

bool Decoder::valid() {
  if (overlong_ || !unstuff() || size_ <= kChecksumSize + kTypeAt) {
    count(frame_errors_);
    return false;
  }
  size_ = static_cast<uint8_t>(size_ - kChecksumSize);
  Reader checksum(buffer_ + size_);
  if (checksum.u32() != crc32(buffer_, size_, seed_of(buffer_[kTypeAt]))) {
    count(crc_errors_);
    return false;
  }
  if (!well_formed(buffer_, size_)) {
    count(frame_errors_);
    return false;
  }
  return true;
}

// COBS undone in place: what is written never overtakes what is read.
bool Decoder::unstuff() {
  uint8_t read = 0;
  size_ = 0;
  while (true) {
    const uint8_t code = buffer_[read++];
    if (code - 1 > length_ - read) return false;
    for (uint8_t i = 1; i < code; ++i) buffer_[size_++] = buffer_[read++];
    if (read == length_) return true;
    if (code < 0xFF) buffer_[size_++] = 0;
  }
}

bool SendQueue::push(Body body, uint16_t spare) {
  body.u32(crc32(body.data(), body.size(), seed_of(body[kTypeAt])));
  if (kRoom - size_ < body.size() + kOverhead + spare) return false;
  put(0);
  for (uint8_t start = 0; start <= body.size(); ++start) {
    uint8_t end = start;
    while (end < body.size() && body[end] != 0) ++end;
    put(static_cast<uint8_t>(end - start + 1));
    for (; start < end; ++start) put(body[start]);
  }
  put(0);
  return true;
}

bool SendQueue::pop(uint8_t& byte) {
  if (size_ == 0) return false;
  byte = ring_[first_];
  first_ = static_cast<uint16_t>((first_ + 1) % kRoom);
  --size_;
  return true;
}

void SendQueue::put(uint8_t byte) {
  ring_[(first_ + size_) % kRoom] = byte;
  ++size_;
}

}  // namespace softrobot
