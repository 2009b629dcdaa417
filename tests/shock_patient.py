"""A patient in shock with weak ventricles and full veins, as plain data of a case."""

SHOCK = {
    "format": 1,
    "patient": {
        "id": "shock", "sex": "male", "age_years": 60, "height_cm": 178, "weight_kg": 80,
        "heart_rate_bpm": 95,
    },
    "parameters": {"Emaxlv": 0.466, "Emaxrv": 0.206, "Rmc": 0.645, "Rpmc": 0.138, "P0svn": 46.0},
}  # fmt: skip
