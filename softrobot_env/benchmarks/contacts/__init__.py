"""Contacts: what the rule of their timestep is worth, and checks against exact solutions."""
