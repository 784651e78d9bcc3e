"""Robot files: what is known of a real robot before it moves."""
