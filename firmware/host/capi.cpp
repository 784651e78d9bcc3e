// The device as a C library, for softrobot_env/hardware/virtual_robot.py.
#include <new>

#include "../core/device.h"

using softrobot::BoardInfo;
using softrobot::Device;
using softrobot::Measured;
using softrobot::Outputs;

extern "C" {

// NULL without memory.
Device* softrobot_create(uint8_t n, uint32_t boot_id, uint8_t reset_cause, uint16_t capabilities) {
  const BoardInfo info = {n, boot_id, static_cast<softrobot::Reset>(reset_cause), capabilities};
  return new (std::nothrow) Device(info);
}

void softrobot_destroy(Device* device) { delete device; }

void softrobot_run(Device* device, uint32_t now_us, const Measured* measured,
                   const uint8_t* received, uint16_t size) {
  device->run(now_us, *measured, received, size);
}

uint16_t softrobot_transmit(Device* device, uint8_t* data, uint16_t room) {
  uint16_t size = 0;
  while (size < room && device->transmit(data[size])) ++size;
  return size;
}

void softrobot_outputs(const Device* device, Outputs* outputs) { *outputs = device->outputs(); }
}
