"""The ambiguous function of the paper's appendix A: which methods answer with one of its branches, and which with their mean."""
