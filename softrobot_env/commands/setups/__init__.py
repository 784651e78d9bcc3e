"""The robots that commands can be given."""
