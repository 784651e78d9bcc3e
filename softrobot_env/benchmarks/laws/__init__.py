"""Every law on every robot, on generic paths at shares of the robot's first frequency."""
