"""Models: circuits of the patient and of each device, and how they are joined."""

from eclsim.models.circulation import circulation, shi_hose_circulation
from eclsim.models.crrt import crrt
from eclsim.models.ecmo import POSITIONS, ecmo
from eclsim.models.lvad import lvad

__all__ = ["POSITIONS", "circulation", "crrt", "ecmo", "lvad", "shi_hose_circulation"]
