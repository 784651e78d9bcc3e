"""What PPO learns from nothing with nobody's tuning: the defaults of stable-baselines3."""
