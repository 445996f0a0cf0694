"""Training the networks of body avoidance on recorded poses and on geometry made around them (Starke et al. 2024, section 6.5)."""
