"""What all beam models compute with: time integration, bands, quaternions."""
