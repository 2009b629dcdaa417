"""Fluid and what is dissolved in it, in time: plasma, red cells, interstitium, protein, solutes."""
