"""The public names, each with the module that defines it: read by type checkers and by `eclsim` itself."""

from eclsim.cases.reading import read_case as read_case
from eclsim.circuit import Choice as Choice
from eclsim.circuit import Circuit as Circuit
from eclsim.circuit import Compartment as Compartment
from eclsim.circuit import Connection as Connection
from eclsim.circuit import StartPressure as StartPressure
from eclsim.circuit import StartVolume as StartVolume
from eclsim.crrt_study.study import crrt_study as crrt_study
from eclsim.devices.crrt import crrt as crrt
from eclsim.devices.ecmo import ecmo as ecmo
from eclsim.devices.lvad import lvad as lvad
from eclsim.devices.registry import register_device as register_device
from eclsim.execution import Distribution as Distribution
from eclsim.execution import Shard as Shard
from eclsim.identification.fit import FitResult as FitResult
from eclsim.identification.fit import fit as fit
from eclsim.identification.multi_start import MultiStart as MultiStart
from eclsim.identification.nuts import Sampling as Sampling
from eclsim.identification.posterior import PosteriorResult as PosteriorResult
from eclsim.identification.posterior import PosteriorSettings as PosteriorSettings
from eclsim.identification.posterior import posterior as posterior
from eclsim.identification.settings import FitSettings as FitSettings
from eclsim.identification.track_result import TrackResult as TrackResult
from eclsim.identification.tracking import Tracker as Tracker
from eclsim.identification.tracking import TrackSettings as TrackSettings
from eclsim.identification.tracking import track as track
from eclsim.orbit.equation import OrbitOptions as OrbitOptions
from eclsim.orbit.execution import Execution as Execution
from eclsim.orbit.model import Model as Model
from eclsim.orbit.model import model_of as model_of
from eclsim.orbit.status import Status as Status
from eclsim.orbit.steady import Batch as Batch
from eclsim.outputs.results import derivatives as derivatives
from eclsim.outputs.results import simulate_many as simulate_many
from eclsim.outputs.steady_beat import SteadyBeat as SteadyBeat
from eclsim.outputs.steady_beat import steady_beat as steady_beat
from eclsim.patient.circulation import circulation as circulation
from eclsim.reporting.schematic import draw_circuit as draw_circuit
from eclsim.sensitivity.analysis import SobolSettings as SobolSettings
from eclsim.sensitivity.analysis import sensitivity as sensitivity
from eclsim.sensitivity.identifiability import identifiability as identifiability
from eclsim.simulation.pressure_volume import plot_pressure_volume as plot_pressure_volume
from eclsim.simulation.single import simulate as simulate
from eclsim.simulation.waveforms import plot_waveforms as plot_waveforms

__version__: str
