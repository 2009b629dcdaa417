"""A small cohort table as text, for tests."""

from eclsim.cases.cohort import COLUMNS, MEASUREMENT

HEADER = ["patient_id", MEASUREMENT, *(c for c in COLUMNS if c != "patient_id")]


def cohort(*rows: dict[str, str]) -> bytes:
    usual = {
        "patient_id": "P01", MEASUREMENT: "1", "sex": "female", "age_years": "70", "heart_rate_bpm": "90",
        "SP": "100", "DP": "60", "MAP": "75", "CO": "3", "ecmo_pump": "Rotaflow", "ecmo_speed_rpm": "3000",
        "oxygenator": "Quadrox-i Adult", "drainage_fr": "21", "return_fr": "17",
    }  # fmt: skip
    lines = [",".join(HEADER)]
    lines += [",".join((usual | row).get(name, "") for name in HEADER) for row in rows]
    return "\n".join(lines).encode()
