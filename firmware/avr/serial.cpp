#include "serial.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/setbaud.h>

#if defined(USART_RX_vect)
#define RECEIVED_vect USART_RX_vect
#define SENDABLE_vect USART_UDRE_vect
#else
#define RECEIVED_vect USART0_RX_vect
#define SENDABLE_vect USART0_UDRE_vect
#endif

namespace softrobot {
namespace {

// One side writes, the other reads, one of them in an interrupt: indices of one byte need no lock.
template <uint16_t kRoom>
class Ring {
  static_assert(kRoom <= 256, "the indices have one byte");

 public:
  bool empty() const { return first_ == end_; }
  bool full() const { return next(end_) == first_; }
  void put(uint8_t byte) {
    data_[end_] = byte;
    end_ = next(end_);
  }
  uint8_t take() {
    const uint8_t byte = data_[first_];
    first_ = next(first_);
    return byte;
  }

 private:
  static uint8_t next(uint8_t i) { return static_cast<uint8_t>((i + 1) % kRoom); }

  volatile uint8_t data_[kRoom];
  volatile uint8_t first_ = 0, end_ = 0;
};

Ring<256> received;  // lasts 5 ms at 500000 baud: longer than any pass
Ring<64> waiting;

}  // namespace

// What finds no room is lost, and the checksum of its frame tells.
ISR(RECEIVED_vect) {
  const uint8_t byte = UDR0;
  if (!received.full()) received.put(byte);
}

ISR(SENDABLE_vect) {
  if (waiting.empty()) {
    UCSR0B = static_cast<uint8_t>(UCSR0B & ~_BV(UDRIE0));
  } else {
    UDR0 = waiting.take();
  }
}

namespace serial {

void begin() {
  UBRR0 = UBRR_VALUE;
#if USE_2X
  UCSR0A = _BV(U2X0);
#else
  UCSR0A = 0;
#endif
  UCSR0C = static_cast<uint8_t>(_BV(UCSZ01) | _BV(UCSZ00));  // 8 bits, no parity, one stop bit
  UCSR0B = static_cast<uint8_t>(_BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0));
}

uint8_t read(uint8_t* data, uint8_t room) {
  uint8_t size = 0;
  while (size < room && !received.empty()) data[size++] = received.take();
  return size;
}

bool can_write() { return !waiting.full(); }

void write(uint8_t byte) {
  waiting.put(byte);
  UCSR0B = static_cast<uint8_t>(UCSR0B | _BV(UDRIE0));
}

}  // namespace serial
}  // namespace softrobot
