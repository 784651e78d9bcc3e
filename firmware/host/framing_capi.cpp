// The framing alone as a C library, for tests against softrobot_env/hardware/protocol/messages.py.
#include <new>

#include "../core/framing.h"

using softrobot::Body;
using softrobot::Decoder;
using softrobot::SendQueue;

extern "C" {

// NULL without memory.
Decoder* softrobot_decoder_create() { return new (std::nothrow) Decoder; }

void softrobot_decoder_destroy(Decoder* decoder) { delete decoder; }

// Takes one byte; size of the body that it completed, copied into `body`, or 0.
uint8_t softrobot_decoder_feed(Decoder* decoder, uint8_t byte, uint8_t* body) {
  if (!decoder->feed(byte)) return 0;
  for (uint8_t i = 0; i < decoder->size(); ++i) body[i] = decoder->body()[i];
  return decoder->size();
}

uint16_t softrobot_decoder_crc_errors(const Decoder* decoder) { return decoder->crc_errors(); }

uint16_t softrobot_decoder_frame_errors(const Decoder* decoder) { return decoder->frame_errors(); }

// Frame of a body of at most 72 bytes; returns its size.
uint16_t softrobot_encode(const uint8_t* data, uint8_t size, uint8_t* frame) {
  Body body;
  for (uint8_t i = 0; i < size; ++i) body.u8(data[i]);
  SendQueue queue;
  queue.push(body, 0);
  uint16_t length = 0;
  while (queue.pop(frame[length])) ++length;
  return length;
}
}
