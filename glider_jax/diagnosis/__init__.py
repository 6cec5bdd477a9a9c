"""Locate where a recording and the base model differ, name what was left out, model it, show the fit improve."""
