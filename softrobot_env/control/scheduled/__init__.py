"""Laws whose gains and equilibria come from a table over the workspace of any robot."""
