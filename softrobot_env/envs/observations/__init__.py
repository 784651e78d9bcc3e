"""What environments observe: names, bounds, read-outs, sensors."""
