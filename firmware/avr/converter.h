// MCP3208: eight channels of 12 bits, by SPI.
#pragma once

#include <stdint.h>

namespace softrobot {
namespace converter {

void begin();

// 0 to 4095 of a channel from 0 to 7; takes about 30 µs.
uint16_t read(uint8_t channel);

}  // namespace converter
}  // namespace softrobot
