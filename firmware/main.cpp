// The main loop, the same on every board.
#include "core/board.h"
#include "core/device.h"

using softrobot::Device;
using softrobot::Measured;
namespace board = softrobot::board;

namespace {

void send(Device& device) {
  uint8_t byte;
  while (board::can_write() && device.transmit(byte)) board::write(byte);
}

}  // namespace

int main() {
  board::begin();
  static Device device(board::info());
  Measured measured = {};
  uint8_t received[64];
  while (true) {
    board::measure(measured);
    const uint8_t size = board::read(received, sizeof(received));
    device.run(board::now_us(), measured, received, size);
    board::apply(device.outputs());
    send(device);
    board::feed_watchdog();
  }
}
