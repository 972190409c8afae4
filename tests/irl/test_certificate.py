import math
from dataclasses import replace

import numpy as np
import pytest

from tablesetting.irl.certificate import MIN_FIT, Bound, doubts
from tablesetting.irl.posterior import Posterior
from tablesetting.irl.risk import RiskConfig
from tablesetting.irl.sampler import Diagnosis

RISK = RiskConfig(alpha=0.9, delta=0.1)
TIGHT = Bound(
    value=0.1,
    var=0.08,
    alpha=0.95,
    delta=0.025,
    look=1,
    num_draws=300,
    rank=293,
    num_situations=40,
)
LOOSE = replace(TIGHT, value=0.3)
NONE = replace(TIGHT, value=math.inf, num_draws=60, rank=None)
SOUND = Posterior(
    weights=np.eye(2),
    log_posts=np.zeros(2),
    scales=None,
    map_weights=np.eye(2)[0],
    mean_weights=np.eye(2)[0],
    guess="map",
    num_chains=1,
    acceptance_rate=0.2,
    diagnosis=Diagnosis(bulk_ess=500.0, tail_ess=400.0, rhat=1.003),
    is_sound=True,
    log_evidence=0.0,
)
UNSOUND = replace(SOUND, is_sound=False, diagnosis=Diagnosis(60.0, 90.0, 1.2))


def find_doubts(bound=TIGHT, posterior=SOUND, *, epsilon=0.2, fit=0.5):
    return doubts(bound, epsilon, posterior, fit)


def test_bound_of_two_situations_by_hand():
    losses = np.stack([np.arange(1.0, 101.0), np.arange(100.0, 0.0, -1.0) / 2.0])
    bound = Bound.of_losses(losses, 1000.0, RISK, look=1)
    # P(B >= 95) = 0.0576 for B binomial in 100 and 0.9, P(B >= 96) = 0.0237.
    assert bound == Bound(
        value=96.0,
        var=90.0,
        alpha=0.9,
        delta=0.05,
        look=1,
        num_draws=100,
        rank=96,
        num_situations=2,
    )


def test_draws_are_the_whole_ones_that_the_samples_are_worth():
    losses = np.arange(1.0, 101.0)[None]
    bound = Bound.of_losses(losses, 50.9, RISK, look=1)
    # P(B >= 49) = 0.0338 for B binomial in 50 and 0.9, P(B >= 48) = 0.1117.
    assert (bound.num_draws, bound.rank, bound.value) == (50, 49, 98.0)
    assert bound.var == 90.0


@pytest.mark.parametrize(
    ("ess", "look", "is_finite"),
    [(29.0, 1, True), (28.9, 1, False), (38.9, 2, False), (39.0, 2, True), (0.5, 1, 0)],
)
def test_bound_is_infinite_below_the_fewest_draws_of_its_look(ess, look, is_finite):
    # 0.9 ** 29 is below 0.1 / 2, and 0.9 ** 39 below 0.1 / 6.
    bound = Bound.of_losses(np.arange(100.0)[None], ess, RISK, look)
    assert bound.num_draws == math.floor(ess)
    assert math.isfinite(bound.value) == is_finite
    assert (bound.rank is not None) == is_finite


@pytest.mark.parametrize(("look", "share"), [(1, 0.05), (2, 0.1 / 6), (9, 0.1 / 90)])
def test_each_look_spends_its_share_of_delta(look, share):
    bound = Bound.of_losses(np.arange(100.0)[None], 100.0, RISK, look)
    assert bound.look == look
    assert bound.delta == pytest.approx(share)


def test_later_looks_at_the_same_losses_bound_them_no_lower():
    losses = np.random.default_rng(0).random((3, 200))
    values = [Bound.of_losses(losses, 200.0, RISK, look).value for look in range(1, 9)]
    assert values == sorted(values)
    assert values[0] < values[-1]


def test_bounds_of_all_looks_hold_at_once_with_the_promised_confidence():
    """The loss in three situations is uniform; the largest VaR is that of the first."""
    risk = RiskConfig(alpha=0.9, delta=0.2)
    rng = np.random.default_rng(0)
    sizes = np.array([[1.0], [0.95], [0.5]])
    misses = []
    for _ in range(1500):
        bounds = [
            Bound.of_losses(sizes * rng.random((3, 80)), 80.0, risk, look)
            for look in range(1, 6)
        ]
        misses.append([bound.value < 0.9 for bound in bounds])
    of_any = np.any(misses, axis=1).mean()
    assert 0.01 < of_any < risk.delta
    of_each = np.mean(misses, axis=0)
    promised = risk.delta / np.array([2, 6, 12, 20, 30])
    assert (of_each <= promised + 3.0 * np.sqrt(promised / 1500)).all()


def test_a_bound_of_too_few_effective_draws_would_not_hold_without_their_count():
    """Every draw comes four times: all draws taken as independent promise too much."""
    risk = RiskConfig(alpha=0.9, delta=0.2)
    losses = np.repeat(np.random.default_rng(0).random((1500, 1, 50)), 4, axis=-1)
    missed = [
        np.mean([Bound.of_losses(each, ess, risk, 1).value < 0.9 for each in losses])
        for ess in (50.0, 200.0)
    ]
    assert missed[0] <= 0.1 + 0.02 < missed[1]


def test_nothing_is_doubted_where_all_is_well():
    assert find_doubts() == []


@pytest.mark.parametrize(
    ("changed", "reasons"),
    [
        ({"bound": LOOSE}, ["the bound, 0.3000, is not below epsilon, 0.2"]),
        ({"epsilon": 0.1}, ["the bound, 0.1000, is not below epsilon, 0.1"]),
        (
            {"bound": replace(TIGHT, value=math.nan)},
            ["the bound, nan, is not below epsilon, 0.2"],
        ),
        (
            {"bound": NONE},
            [
                "the bound, inf, is not below epsilon, 0.2",
                "the effective sample size, 60, is below 72, the least for alpha 0.95 "
                "at delta 0.025",
            ],
        ),
        (
            {"posterior": UNSOUND},
            [
                "the chains have not mixed: effective sample size 60, R-hat 1.200 (at "
                "most 1.01) when their steps were spent"
            ],
        ),
        (
            {"posterior": replace(SOUND, diagnosis=Diagnosis(500.0, 400.0, 1.04))},
            [
                "the chains have not mixed: effective sample size 400, R-hat 1.040 (at "
                "most 1.01)"
            ],
        ),
        (
            {"posterior": replace(SOUND, shares={"a": 0.94, "b": 0.06})},
            [
                "which model of the person holds is open: a 0.94, b 0.06 (one must have "
                "0.95)"
            ],
        ),
        ({"posterior": replace(SOUND, shares={"a": 0.95, "b": 0.05})}, []),
        (
            {"fit": 0.0123},
            [
                "the demonstrations do not fit the model of the person: such as these "
                "come with a probability of 0.0123, below 0.05"
            ],
        ),
    ],
    ids=[
        "bound",
        "equal",
        "no number",
        "sample size",
        "chains",
        "asked for less",
        "open model",
        "sure model",
        "fit",
    ],
)
def test_each_doubt_is_told_for_its_reason_alone(changed, reasons):
    assert find_doubts(**changed) == reasons


def test_all_doubts_are_told_at_once():
    found = find_doubts(NONE, UNSOUND, fit=0.0)
    words = ("the bound", "the effective sample size", "the chains", "the demonstr")
    assert len(found) == 4
    assert all(map(str.startswith, found, words))


@pytest.mark.parametrize(
    ("fit", "is_doubted"), [(MIN_FIT, False), (0.0499, True), (math.nan, True)]
)
def test_demonstrations_must_fit_at_the_level_itself(fit, is_doubted):
    assert bool(find_doubts(fit=fit)) is is_doubted
