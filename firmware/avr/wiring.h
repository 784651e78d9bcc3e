// What is connected where, and how it is scaled. The one file to edit for another rig.
#pragma once

#include <avr/io.h>
#include <stdint.h>

namespace softrobot {
namespace wiring {

constexpr uint8_t kTendons = 3;

#if defined(__AVR_ATmega328P__)
// Uno and Nano. Servos on D3, D5, D6; switch D2; supply of the servos D7; SPI D10 to D13.
#define SERVO_PORT PORTD
#define SERVO_DDR DDRD
constexpr uint8_t kServoMasks[kTendons] = {_BV(PD3), _BV(PD5), _BV(PD6)};
#define SUPPLY_PORT PORTD
#define SUPPLY_DDR DDRD
constexpr uint8_t kSupplyPin = PD7;
#define ESTOP_PORT PORTD
#define ESTOP_PIN PIND
constexpr uint8_t kEstopPin = PD2;
constexpr uint8_t kSelectPin = PB2, kClockPin = PB5, kToConverterPin = PB3;
#elif defined(__AVR_ATmega2560__)
// Mega. Servos on D2, D3, D5; switch D4; supply of the servos D6; SPI D50 to D53.
#define SERVO_PORT PORTE
#define SERVO_DDR DDRE
constexpr uint8_t kServoMasks[kTendons] = {_BV(PE4), _BV(PE5), _BV(PE3)};
#define SUPPLY_PORT PORTH
#define SUPPLY_DDR DDRH
constexpr uint8_t kSupplyPin = PH3;
#define ESTOP_PORT PORTG
#define ESTOP_PIN PING
constexpr uint8_t kEstopPin = PG5;
constexpr uint8_t kSelectPin = PB0, kClockPin = PB1, kToConverterPin = PB2;
#else
#error "wiring.h knows the ATmega328P and the ATmega2560; add the pins of yours"
#endif

// Channels of the MCP3208 after those of the optical sensors, 0 to 3.
constexpr uint8_t kFirstPotentiometer = 4;
constexpr uint8_t kSupplyChannel = 7;

// Supply voltage [mV] at which the converter is full: 5 V behind a divider of two equal resistors.
constexpr uint16_t kSupplyFullMv = 10000;

// Servo potentiometers. Zeros until they are measured: the board then does not claim to measure
// lengths, and stalls are not seen. See README.md.
struct Potentiometer {
  int16_t zero;  // counts when nothing is pulled in
  int16_t gain;  // 0.01 mm per 1000 counts
};
constexpr Potentiometer kPotentiometers[kTendons] = {{0, 0}, {0, 0}, {0, 0}};

}  // namespace wiring
}  // namespace softrobot
