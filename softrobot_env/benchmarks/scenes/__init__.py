"""Random scenes, stepped as environments step them, judged against refined runs."""
