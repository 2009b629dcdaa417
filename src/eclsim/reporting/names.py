"""Words for compartments and connections in figures, keyed by the names of the circuit, in flow order."""

from eclsim.devices.ecmo import POSITIONS

COMPARTMENTS = {
    "ao": "aorta",
    "sart": "systemic arteries",
    "svn": "systemic veins",
    "arch": "aortic arch",
    "descending": "descending aorta",
    "upper": "upper body arteries",
    "lower": "lower body arteries",
    "svc": "superior vena cava",
    "ivc": "inferior vena cava",
    "ra": "right atrium",
    "rv": "right ventricle",
    "pas": "pulmonary sinus",
    "part": "pulmonary arteries",
    "pvn": "pulmonary veins",
    "la": "left atrium",
    "lv": "left ventricle",
    "ecmodrain": "after drainage cannula",
    "ecmotudp": "before pump",
    "ecmotupo": "after pump",
    "ecmooxy": "before oxygenator",
    "ecmotuor": "after oxygenator",
    "ecmoreturn": "before return cannula",
    "crrttuin": "access line",
    "crrttupf": "after roller pump",
    "crrtfil": "before dialyzer",
    "crrttuout": "return line",
}

CONNECTIONS = {
    "ao": "aorta",
    "sart": "organs",
    "svn": "venous return",
    "arch": "descending aorta",
    "archupper": "arch vessels",
    "descending": "iliac arteries",
    "upper": "upper body",
    "lower": "lower body",
    "svc": "superior vena cava",
    "ivc": "inferior vena cava",
    "bronchial": "bronchial return",
    "ra": "tricuspid valve",
    "rv": "pulmonary valve",
    "pas": "pulmonary artery",
    "part": "lungs",
    "pvn": "pulmonary veins",
    "la": "mitral valve",
    "lv": "aortic valve",
    "ecmodrain": "drainage cannula",
    "ecmotudp": "tube to pump",
    "ecmopump": "ECMO pump",
    "ecmotupo": "tube to oxygenator",
    "ecmooxy": "oxygenator",
    "ecmotuor": "tube from oxygenator",
    "ecmoreturn": "return cannula",
    "crrttuin": "access line",
    "crrtpump": "CRRT pump",
    "crrttupf": "tube to dialyzer",
    "crrtfil": "dialyzer",
    "crrttuout": "return line",
    "lvadpump": "LVAD pump",
}

# The names users write as CRRT sites, beside the names of the nodes.
ECMO_POSITIONS = {node: position for position, node in POSITIONS.items()}

GROUPS = {"patient": "Patient", "ecmo": "ECMO", "crrt": "CRRT", "lvad": "LVAD"}


def group_of(name: str) -> str:
    """The group a waveform belongs to, from the name of its compartment or connection."""
    for group in ("ecmo", "crrt", "lvad"):
        if name.startswith(group):
            return group
    return "patient"
