"""Slow laws of fluid and solutes in time: plasma, red cells, interstitium, protein, solutes."""
