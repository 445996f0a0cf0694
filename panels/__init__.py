"""Panels: the sidebar, its preferences, and nothing that computes."""
