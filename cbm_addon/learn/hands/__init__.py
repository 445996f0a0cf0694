"""Training the networks of the hands on free hand poses and on geometry made of noise (Starke et al. 2024, section 6.5)."""
