"""Policies: the thesis' controllers and their extensions; `registry` names them."""
