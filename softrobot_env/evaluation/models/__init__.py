"""How accurate and how stable the models of one robot are."""
