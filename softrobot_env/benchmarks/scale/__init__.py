"""What a million robot-seconds and a sweep on many cores cost, and where the time goes."""
