"""The real robot over serial: wire protocol, driver, configuration, virtual robot."""
