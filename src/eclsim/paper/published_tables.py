"""Tables S-1 to S-4 of Thiel et al. 2025 as printed, to compare with the values that eclsim uses."""

from __future__ import annotations

TABLES: dict[str, dict[str, float]] = {
    "S-1": {
        "etaB": 0.003, "rhoB": 0.00106, "Rao": 0.003, "Rsart": 0.05, "Rmc": 0.5, "Rsvn": 0.01, "Rpas": 0.002,
        "Rpart": 0.01, "Rpmc": 0.05, "Rpvn": 0.006, "Cao": 0.08, "Csart": 0.9, "Csvn": 20.5, "Cpas": 0.18,
        "Cpart": 3.8, "Cpvn": 20.5, "Lao": 6.2e-5, "Lsart": 0.0017, "Lpas": 5.2e-5, "Lpart": 0.0017,
        "CQtri": 400.0, "CQpa": 350.0, "CQmi": 400.0, "CQao": 350.0, "Emaxra": 0.225, "Edra": 0.1575,
        "Emaxrv": 0.45, "RV_Pd_beta": 2.5, "RV_Pd_kappa": 0.028, "RV_Pd_alpha": 0.047, "Emaxla": 0.45,
        "Edla": 0.2125, "Emaxlv": 1.8, "LV_Pd_beta": 2.5, "LV_Pd_kappa": 0.033, "LV_Pd_alpha": 0.064,
    },
    "S-2": {
        "Decmotudp": 0.9625, "Lecmotudp": 200.0, "Decmotupo": 0.9625, "Lecmotupo": 20.0, "Decmotuor": 0.9625,
        "Lecmotuor": 200.0, "Recmooxy": 0.6744, "Cecmodrain": 0.1, "Cecmotudp": 0.1, "Cecmotupo": 0.1,
        "Cecmooxy": 0.008, "Cecmotuor": 0.1, "Cecmoreturn": 0.1,
    },
    "S-3": {
        "Lcrrttuin": 250.0, "Dcrrttuin": 0.3175, "Lcrrttupf": 100.0, "Dcrrttupf": 0.3175, "Lcrrttuout": 250.0,
        "Dcrrttuout": 0.3175, "Rcrrtfil": 15.75, "Ccrrttuin": 0.1, "Ccrrttupf": 0.1, "Ccrrtfil": 0.008,
        "Ccrrttuout": 0.1,
    },
    "S-4": {
        "Csart": 3.1852, "Edla": 2.1167, "Emaxlv": 1.3297, "Emaxrv": 0.10791, "Rmc": 0.75989, "Rpmc": 0.3369,
        "Rsvn": 0.00304,
    },
}  # fmt: skip
