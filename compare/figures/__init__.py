"""Figures and animations; the only room that imports matplotlib."""
