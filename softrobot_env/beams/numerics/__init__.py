"""What all beam models compute with: compilation, time integration, bands, quaternions."""
