"""How far a patient's model can be relied on: prior, posterior by NUTS, predictions with intervals."""
