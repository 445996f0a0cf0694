"""How well a body keeps clear of solids that stand in its way."""
