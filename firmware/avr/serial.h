// USART 0 with buffers that interrupts fill and empty.
#pragma once

#include <stdint.h>

namespace softrobot {
namespace serial {

void begin();

// Received bytes, at most `room`; returns how many.
uint8_t read(uint8_t* data, uint8_t room);

bool can_write();
void write(uint8_t byte);

}  // namespace serial
}  // namespace softrobot
