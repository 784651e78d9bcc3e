// The microcontroller's program: messages in, outputs and messages out, one pass at a time.
// The states are those of messages.DeviceState.
#pragma once

#include <stdint.h>

#include "board.h"
#include "faults.h"
#include "framing.h"
#include "messages.h"
#include "motion.h"
#include "safety.h"
#include "session.h"

namespace softrobot {

class Device {
 public:
  explicit Device(const BoardInfo& info) : info_(info), safety_(info.capabilities) {}

  // One pass of the main loop, at this time, with the bytes that came since the last one. What
  // was due before is done before the bytes are looked at: a late set-point saves no watchdog.
  void run(uint32_t now_us, const Measured& measured, const uint8_t* received, uint16_t size);

  // The next byte to be sent; false if there is none.
  bool transmit(uint8_t& byte) { return queue_.pop(byte); }

  Outputs outputs() const;

 private:
  // device.cpp: what happens by itself.
  void measure(const Measured& measured);
  void expire();
  void move(uint32_t elapsed_us);
  void supervise();
  void react();
  void ramp(uint16_t speed);
  void end(DeviceState state);
  bool driven() const { return motion_.powered(); }
  bool has(uint16_t capability) const { return (info_.capabilities & capability) != 0; }
  const int16_t* length() const;

  // orders.cpp: what the host asks for. Handlers tell why they refuse.
  void handle(const uint8_t* body, uint8_t size);
  Reason obey(const Header& header, Reader in, uint32_t fields_crc);
  Reason hello(const Hello& hello);
  Reason configure(const Config& config, uint32_t crc);
  Reason arm(const Arm& arm);
  Reason setpoint(const Setpoint& setpoint, uint16_t seq);
  Reason check(const Setpoint& setpoint, uint16_t seq);
  bool in_range(const Setpoint& setpoint) const;
  bool near(const Setpoint& setpoint) const;
  Reason ping(uint32_t t_host);
  Reason stop(const Stop& stop);
  Reason emergency_stop();
  Reason clear(uint8_t fault);

  // reports.cpp: what the host is told.
  void report();
  bool state_due() const;
  Body begin(Type type);
  void send_hello_ack(uint32_t nonce);
  void send_config_ack();
  void send_pong(uint32_t t_host);
  void send_nack(const Header& about, Reason reason);
  bool send_fault();
  bool send_state();
  uint16_t warnings() const;

  BoardInfo info_;
  Decoder decoder_;
  SendQueue queue_;
  Config config_ = {};
  Motion motion_;
  Safety safety_;
  Session session_;
  FaultLog faults_;
  Measured measured_ = {};
  DeviceState state_ = DeviceState::kDisarmed;
  bool greeted_ = false;     // by a host of this protocol
  bool configured_ = false;  // since the last hello; the numbers in config_ outlive it for a ramp
  bool ran_ = false;
  uint32_t config_crc_ = 0;
  uint32_t now_us_ = 0;
  uint32_t armed_us_ = 0, ramp_us_ = 0;  // since when
  uint16_t seq_ = 0;        // of the next message
  uint16_t remarks_ = 0;    // warnings about set-points, until a state has told them
  bool echo_waits_ = false;  // a state is to be sent because of a set-point
  bool fault_told_ = false;
  uint32_t echo_us_ = 0, state_us_ = 0, fault_us_ = 0;
};

}  // namespace softrobot
