"""Every policy on plants, robots and twins that it was not tuned on."""
