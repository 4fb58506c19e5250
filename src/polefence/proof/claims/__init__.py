"""Claims that files make, one kind a file."""

from polefence.proof.claims.base import Claim, Verdict, prove
from polefence.proof.claims.bump import BumpResponse
from polefence.proof.claims.delay_margin import DelayMargin
from polefence.proof.claims.disk_margin import DiskMargin, Loops, Unmodelled
from polefence.proof.claims.each_gain import EachGain
from polefence.proof.claims.energy_peak import EnergyPeak
from polefence.proof.claims.estimate import Estimate
from polefence.proof.claims.factor_margin import GainMargin, PhaseMargin
from polefence.proof.claims.free import ImpulseResponse, InitialResponse
from polefence.proof.claims.gain import Gain
from polefence.proof.claims.gain_error import GainError
from polefence.proof.claims.gain_norm import LAW, BoundClaim, GainNorm
from polefence.proof.claims.initial_peak import InitialPeak
from polefence.proof.claims.measured import MeasuredResponse
from polefence.proof.claims.peak_to_peak import PeakToPeak
from polefence.proof.claims.poles import Poles
from polefence.proof.claims.rate import Rate
from polefence.proof.claims.relative_rms import Baseline, RelativeRms, baseline_loop
from polefence.proof.claims.rms import Rms
from polefence.proof.claims.saturation import Saturation
from polefence.proof.claims.sector import Elements, SectorBound
from polefence.proof.claims.signal import SignalClaim, Subject
from polefence.proof.claims.started import is_semidefinite
from polefence.proof.claims.step import StepResponse
from polefence.proof.claims.worst_gain import WorstCaseGain
from polefence.proof.plant import Output

__all__ = [
    "LAW",
    "Baseline",
    "BoundClaim",
    "BumpResponse",
    "Claim",
    "DelayMargin",
    "DiskMargin",
    "EachGain",
    "Elements",
    "EnergyPeak",
    "Estimate",
    "Gain",
    "GainError",
    "GainMargin",
    "GainNorm",
    "ImpulseResponse",
    "InitialPeak",
    "InitialResponse",
    "Loops",
    "MeasuredResponse",
    "Output",
    "PeakToPeak",
    "PhaseMargin",
    "Poles",
    "Rate",
    "RelativeRms",
    "Rms",
    "Saturation",
    "SectorBound",
    "SignalClaim",
    "StepResponse",
    "Subject",
    "Unmodelled",
    "Verdict",
    "WorstCaseGain",
    "baseline_loop",
    "is_semidefinite",
    "prove",
]
