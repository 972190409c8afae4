import hashlib
import json
import math
from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest
from quick_cli import MIXED, content_of, rows_of, start

from tablesetting.experiments.certificate import CERTIFICATE_FORMAT, hash_demonstrations
from tablesetting.irl.risk import upper_bound_rank
from tablesetting.reward.likelihood import Demonstration
from tablesetting.reward.tasks import VASE


def certificate_of(folder):
    return content_of(folder, "certificate.json")


def keys_of(content):
    """List the names in a JSON object, those of the objects in it behind a dot."""
    for name, value in content.items():
        yield name
        if isinstance(value, dict):
            yield from (f"{name}.{inner}" for inner in value)


@pytest.fixture(scope="module")
def certified_run(tmp_path_factory):
    """A run that need not ask anything, as 2 table units are more than the table."""
    folder = tmp_path_factory.mktemp("runs") / "certified"
    options = ("--epsilon", "2", "--delta", "0.1", "--num-queries", "3")
    assert start(folder, *options, "--require-certificate", preset=MIXED) == 0
    return folder


def test_a_certificate_has_all_the_fields_of_its_format(certified_run, vase_run):
    for folder in (certified_run, vase_run):
        certificate = certificate_of(folder)
        assert certificate["format"] == CERTIFICATE_FORMAT
        names = {name for name in keys_of(certificate) if name[:9] != "versions."}
        assert names == {
            *("format", "certified", "doubts", "claim", "task", "epsilon"),
            *("bound", "var", "alpha", "delta"),
            *("spending", "spending.rule", "spending.look", "spending.delta"),
            *("order", "order.rank", "order.of"),
            *("layouts", "layouts.distribution", "layouts.count", "layouts.sha256"),
            *("sampler", "sampler.num_samples", "sampler.bulk_ess"),
            *("sampler.tail_ess", "sampler.kept_ess", "sampler.rhat"),
            "sampler.has_mixed",
            *("sampler.target_ess", "sampler.max_rhat"),
            *("model", "model.likelihood", "model.shares", "model.guess"),
            *("model.noise_std", "model.noise_spread"),
            *("fit", "fit.p_value", "fit.explained", "fit.foretold"),
            *("demonstrations", "demonstrations.count", "demonstrations.sha256"),
            "versions",
        }
        assert (certificate["claim"] is None) is (not certificate["certified"])


def test_a_bound_below_epsilon_is_certified_and_stops_the_run(certified_run):
    summary = content_of(certified_run, "summary.json")
    certificate = certificate_of(certified_run)
    assert summary["stopped"] == "epsilon"
    assert len(rows_of(certified_run)) == 1
    assert certificate["certified"] is summary["certified"] is True
    assert certificate["doubts"] == summary["doubts"] == []
    assert 0.0 < certificate["var"] <= certificate["bound"] < 2.0
    assert certificate["sampler"]["has_mixed"]
    assert certificate["fit"]["p_value"] >= 0.05


def test_the_bound_is_the_order_statistic_that_delta_asks_for(certified_run):
    certificate = certificate_of(certified_run)
    order, spending = certificate["order"], certificate["spending"]
    assert certificate["delta"] == 0.1
    assert (spending["look"], spending["delta"]) == (1, 0.1 / 2)
    assert order["rank"] == upper_bound_rank(order["of"], 0.95, 0.1 / 2)
    sampler = certificate["sampler"]
    ess, num_samples = sampler["bulk_ess"], sampler["num_samples"]
    kept_ess = num_samples * math.tanh(min(ess, sampler["tail_ess"]) / num_samples)
    assert sampler["kept_ess"] == pytest.approx(kept_ess)
    assert order["of"] == int(kept_ess)


def test_a_look_after_every_demonstration_has_a_share_of_delta(vase_run):
    certificate = certificate_of(vase_run)
    assert certificate["delta"] == 0.05
    assert (
        certificate["spending"]["look"] == certificate["demonstrations"]["count"] == 3
    )
    assert certificate["spending"]["delta"] == pytest.approx(0.05 / (3 * 4))
    assert len(certificate["fit"]["foretold"]) == 3 - 1


def test_the_certificate_agrees_with_the_other_files(certified_run):
    certificate = certificate_of(certified_run)
    resolved = content_of(certified_run, "config.json")["resolved"]
    (row,) = rows_of(certified_run)
    assert certificate["bound"] == pytest.approx(float(row["deployment_bound"]))
    assert certificate["fit"]["p_value"] == pytest.approx(float(row["fit"]))
    assert certificate["epsilon"] == resolved["epsilon"] == 2.0
    layouts = certificate["layouts"]
    assert (layouts["distribution"], layouts["count"]) == ("valid", 100)
    assert len(layouts["sha256"]) == 64
    problem = resolved["problem"]
    model = certificate["model"]
    assert (model["likelihood"], model["guess"]) == (problem["likelihood"], "mean")
    assert "beta" not in model  # It took no part.
    assert model["noise_std"] == problem["noise"]["noise_std"]
    posterior = np.load(certified_run / "posterior.npz")
    sampler = certificate["sampler"]
    assert sampler["num_samples"] == len(posterior["weights"])
    for name in ("bulk_ess", "tail_ess", "rhat"):
        assert sampler[name] == pytest.approx(float(posterior[name]))


def test_a_bound_above_epsilon_is_not_certified_when_the_budget_ends(tmp_path, capsys):
    options = ("--num-queries", "0", "--epsilon", "0.01")
    assert start(tmp_path / "run", *options, preset=MIXED) == 0
    certificate = certificate_of(tmp_path / "run")
    assert content_of(tmp_path / "run", "summary.json")["stopped"] == "budget"
    assert not certificate["certified"]
    (doubt,) = certificate["doubts"]
    bound = f"the bound, {certificate['bound']:.4f}, is not below epsilon, 0.01"
    assert doubt == bound
    told = capsys.readouterr().out
    assert f"not certified:\n  {bound}\n" in told
    share = content_of(tmp_path / "run", "summary.json")["share_within_epsilon"]
    assert f"in truth: error below 0.01 in {share:.0%} of the test layouts" in told


def test_chains_that_have_not_mixed_are_not_relied_on(vase_run):
    certificate = certificate_of(vase_run)
    assert certificate["bound"] is certificate["order"]["rank"] is None
    assert not certificate["sampler"]["has_mixed"]
    texts = ("is not below epsilon", "effective sample size", "have not mixed")
    for doubt, text in zip(certificate["doubts"], texts, strict=True):
        assert text in doubt
    assert content_of(vase_run, "summary.json")["deployment_bound"] is None


def test_a_missing_certificate_is_a_failure_where_it_is_required(tmp_path, capsys):
    options = ("--num-queries", "0", "--require-certificate")
    assert start(tmp_path / "run", *options) == 1
    assert "not certified:\n  the bound" in capsys.readouterr().out
    assert not certificate_of(tmp_path / "run")["certified"]
    assert content_of(tmp_path / "run", "summary.json")["stopped"] == "budget"
    assert start(tmp_path / "run", *options, "--resume") == 1
    assert "finished already, not certified" in capsys.readouterr().out


def test_a_certificate_that_is_required_may_be_there_already(certified_run):
    options = ("--epsilon", "2", "--delta", "0.1", "--num-queries", "3")
    resumed = (*options, "--require-certificate", "--resume")
    assert start(certified_run, *resumed, preset=MIXED) == 0


def test_a_run_asks_on_for_a_certificate_that_is_required(tmp_path):
    """After one demonstration the bound is small enough, and the model open."""
    options = ("--likelihood", "auto", "--epsilon", "2")
    options += ("--num-queries", "1", "--execute", "0")
    assert start(tmp_path / "run", *options, preset=MIXED) == 0
    assert content_of(tmp_path / "run", "summary.json")["stopped"] == "epsilon"
    (doubt,) = certificate_of(tmp_path / "run")["doubts"]
    assert "which model of the person holds is open" in doubt
    assert len(rows_of(tmp_path / "run")) == 1
    options += ("--require-certificate",)
    assert start(tmp_path / "required", *options, preset=MIXED) == 1
    assert len(rows_of(tmp_path / "required")) == 2
    model = certificate_of(tmp_path / "required")["model"]
    assert (model["beta"], model["noise_std"]) == (100.0, 0.01)


def test_the_paper_preset_certifies_nothing(tmp_path):
    """However large epsilon is: its chain does not sample the posterior."""
    options = ("--preset", "paper", "--num-queries", "0", "--epsilon", "2")
    assert start(tmp_path / "run", *options) == 0
    certificate = certificate_of(tmp_path / "run")
    assert content_of(tmp_path / "run", "summary.json")["stopped"] == "epsilon"
    assert not certificate["certified"]
    assert "does not keep to the prior" in certificate["doubts"][-1]


def test_the_hash_is_of_what_was_demonstrated(vase_run):
    """As anybody can check: demonstrations.json, compact and with its keys in order."""
    content = content_of(vase_run, "demonstrations.json")
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    expected = hashlib.sha256(text.encode()).hexdigest()
    assert certificate_of(vase_run)["demonstrations"]["sha256"] == expected


def test_the_hash_changes_with_any_demonstration():
    def hashed(*demos, task=VASE):
        return hash_demonstrations(
            SimpleNamespace(
                learning=SimpleNamespace(demos=demos),
                setup=SimpleNamespace(problem=SimpleNamespace(task=task)),
            )
        )

    layout = np.array(VASE.first_layout)
    demo = Demonstration(layout, np.array([0.5, 0.5]))
    moved = Demonstration(layout, np.array([0.5, 0.5 + 1e-15]))
    other = Demonstration(layout + 1e-15, np.array([0.5, 0.5]))
    hashes = [hashed(demo), hashed(moved), hashed(other), hashed(demo, demo)]
    assert len(set(hashes)) == 4
    assert hashed(Demonstration(**asdict(demo))) == hashes[0]
