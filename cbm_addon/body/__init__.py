"""The body against solids: whole poses that keep clear of a scene while head and hands stay with their trackers and planted feet stand."""
