"""The protocol between host and robot: frames, messages, handshake, session; no port, no clock."""
