"""Panels: what is shown in the sidebar, and nothing that computes."""
