"""Training: data sets, networks, the training loop and export. The only room, with evaluate, that may import torch."""
