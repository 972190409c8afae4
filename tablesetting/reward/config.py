"""How a placement preference is learned: the settings and the two presets."""

from dataclasses import dataclass, field
from typing import Literal

from tablesetting.irl.posterior import Guess
from tablesetting.irl.risk import RiskConfig
from tablesetting.irl.sampler import McmcConfig
from tablesetting.reward.likelihood import BoltzmannConfig
from tablesetting.reward.placement_likelihood import NoiseConfig
from tablesetting.reward.rbf import RbfWidths

ModelName = Literal["boltzmann", "placement"]
LikelihoodName = Literal[ModelName, "auto"]


@dataclass(frozen=True)
class PlacementConfig:
    """How a placement preference is learned."""

    candidates: Literal["any", "one-moved"] = "any"
    """Layouts to choose the query from: anew, or the last one with one object moved."""
    num_candidates: int = 50
    """How many layouts to choose the query from."""
    are_points: bool = False
    """Whether objects are points that may overlap, as in the paper, rather than things
    of true size that stand apart and leave the item room."""
    likelihood: LikelihoodName = "placement"
    """Model of the demonstrator: noisily rational, near the best placement, or both,
    weighed by their evidence."""
    guess: Guess | None = None
    """What the robot acts on; None takes what is better: the MAP for `boltzmann`, the
    mean weights for `placement`."""
    boltzmann: BoltzmannConfig = field(default_factory=BoltzmannConfig)
    """The noisily rational demonstrator."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    """The demonstrator who nearly hits the best placement."""
    mcmc: McmcConfig = field(default_factory=McmcConfig)
    """Sampler of the posterior."""
    risk: RiskConfig = field(default_factory=RiskConfig)
    """The quantile that bounds the loss."""
    widths: RbfWidths = field(default_factory=RbfWidths)
    """Widths of the RBFs."""

    def __post_init__(self) -> None:
        if self.num_candidates < 1:
            raise ValueError(
                f"`num_candidates` must be at least 1; got {self.num_candidates}"
            )
        spreads = self.noise.noise_spread, self.boltzmann.beta_spread
        if self.likelihood == "auto" and max(spreads) > 0.0:
            raise ValueError(
                "`likelihood` auto weighs models of fixed noise and rationality; got "
                f"`noise_spread` {spreads[0]} and `beta_spread` {spreads[1]}"
            )
        mcmc = self.mcmc
        is_annealed = mcmc.num_particles > 0 and not mcmc.starts_at_map
        if self.likelihood == "auto" and not is_annealed:
            raise ValueError(
                "`likelihood` auto needs evidence, which annealing gives; got "
                f"`num_particles` {mcmc.num_particles} and `starts_at_map` "
                f"{mcmc.starts_at_map}"
            )


DEFAULT = PlacementConfig()
"""Statistically sound, for things that can be set on a table."""

PAPER = PlacementConfig(
    candidates="one-moved",
    are_points=True,
    likelihood="boltzmann",
    boltzmann=BoltzmannConfig(quadrature="lattice", resolution=10),
    mcmc=McmcConfig(
        num_chains=1,
        num_steps=2500,
        burn_in=0,
        num_particles=0,
        num_samples=100,
        target_ess=None,
        target_acceptance=None,
        is_prior_uniform=False,
        num_map_steps=0,
        starts_at_map=True,
    ),
    risk=RiskConfig(rank_offset=1),
)
"""What reproduces the published curves."""

PRESETS: dict[str, PlacementConfig] = {"default": DEFAULT, "paper": PAPER}
