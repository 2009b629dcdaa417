"""A small patient as the text of a case file, for tests: alone, and on V-A ECMO with CRRT."""

PATIENT = """format = 1
[patient]
id = "P01"
sex = "male"
age_years = 60
height_cm = 178
weight_kg = 80
heart_rate_bpm = 80
"""
ON_ECMO = f"""{PATIENT}[ecmo]
pump = "Rotaflow"
speed_rpm = 3000
oxygenator = "Quadrox-i Adult"
mode = "VA"
[crrt]
flow_ml_min = 200
access_site = "post_oxy"
return_site = "pre_oxy"
"""
