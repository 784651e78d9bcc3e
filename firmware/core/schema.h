// Written by `python scripts/firmware_schema.py`. Do not edit.
#pragma once

#include <stdint.h>

namespace softrobot {

constexpr uint8_t kProtocol = 1;
constexpr uint8_t kMostTendons = 6;
constexpr uint8_t kAdcChannels = 4;
constexpr uint8_t kModeLength = 0;
constexpr uint8_t kLongestFrame = 160;  // between its zeros
constexpr uint32_t kSchema = 0x7f7dc78a;

enum class Type : uint8_t {
  kHello = 1,
  kConfig = 2,
  kArm = 3,
  kSetpoint = 4,
  kPing = 5,
  kStop = 6,
  kEStop = 7,
  kClear = 8,
  kDisarm = 9,
  kHelloAck = 65,
  kConfigAck = 66,
  kState = 67,
  kPong = 68,
  kFaultReport = 69,
  kNack = 70,
};

enum class DeviceState : uint8_t {
  kDisarmed = 0,
  kArmed = 1,
  kRunning = 2,
  kRamping = 3,
  kLatched = 4,
};

enum class Fault : uint8_t {
  kNone = 0,
  kWatchdog = 1,
  kEstop = 2,
  kForce = 3,
  kSlack = 4,
  kStall = 5,
  kAdc = 6,
  kBrownOut = 7,
};

enum class Reset : uint8_t {
  kPowerOn = 0,
  kExternal = 1,
  kBrownOut = 2,
  kWatchdog = 3,
};

enum class Reason : uint8_t {
  kState = 1,
  kSession = 2,
  kConfig = 3,
  kCount = 4,
  kRange = 5,
  kFar = 6,
  kFault = 7,
  kProtocol = 8,
  kLate = 9,
  kSequence = 10,
  kMode = 11,
};

namespace capability {
constexpr uint16_t kLength = 1;
constexpr uint16_t kForce = 2;
constexpr uint16_t kAdc = 4;
constexpr uint16_t kSupply = 8;
constexpr uint16_t kEstopSwitch = 16;
}  // namespace capability

namespace warning {
constexpr uint16_t kSlewing = 1;
constexpr uint16_t kAdcRail = 2;
constexpr uint16_t kLateSetpoint = 4;
constexpr uint16_t kOldSequence = 8;
}  // namespace warning

// Size of a body: `fixed + n * per_tendon` bytes, header included. Where the type tells its
// number of tendons, n stands at index `n_at`, which is 0 for the other types.
struct Layout {
  uint8_t fixed, per_tendon, n_at;
};

// False for an unknown type.
inline bool layout_of(uint8_t type, Layout& layout) {
  switch (type) {
    case 1: layout = {10, 0, 0}; break;  // Hello
    case 2: layout = {26, 16, 4}; break;  // Config
    case 3: layout = {10, 0, 0}; break;  // Arm
    case 4: layout = {14, 2, 13}; break;  // Setpoint
    case 5: layout = {8, 0, 0}; break;  // Ping
    case 6: layout = {8, 0, 0}; break;  // Stop
    case 7: layout = {4, 0, 0}; break;  // EStop
    case 8: layout = {5, 0, 0}; break;  // Clear
    case 9: layout = {6, 0, 0}; break;  // Disarm
    case 65: layout = {24, 0, 20}; break;  // HelloAck
    case 66: layout = {8, 0, 0}; break;  // ConfigAck
    case 67: layout = {36, 6, 15}; break;  // State
    case 68: layout = {12, 0, 0}; break;  // Pong
    case 69: layout = {14, 0, 0}; break;  // FaultReport
    case 70: layout = {8, 0, 0}; break;  // Nack
    default: return false;
  }
  return true;
}

}  // namespace softrobot
