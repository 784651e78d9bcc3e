"""What the models compute in the accuracy benchmark, each with its truth."""
