import numpy as np
import pytest
from quick_cli import content_of, rows_of, start

QUICKEST = ("--num-queries", "1", "--execute", "0")


def test_options_of_learning_stand_beside_the_others_in_config_json(tmp_path):
    options = ("--likelihood", "auto", "--guess", "map", "--noise", "0.02")
    options += ("--beta", "50", "--teacher", "noisy", "--truth", "prior", "--points")
    assert start(tmp_path / "run", "--num-queries", "0", *options) == 0
    config = content_of(tmp_path / "run", "config.json")
    found = config["options"]
    assert "learning" not in found
    expected = {
        "task": "vase",
        "likelihood": "auto",
        "guess": "map",
        "noise": 0.02,
        "noise_spread": 0.0,
        "beta": 50.0,
        "beta_spread": 0.0,
        "teacher": "noisy",
        "truth": "prior",
        "points": True,
        "delta": 0.05,
        "require_certificate": False,
        "audit": False,
        "netcdf": False,
    }
    assert {name: found[name] for name in expected} == expected
    problem = config["resolved"]["problem"]
    assert problem["are_points"]
    assert problem["noise"]["noise_std"] == 0.02
    assert problem["boltzmann"]["beta"] == 50.0


def test_both_models_are_weighed_by_auto(tmp_path):
    assert start(tmp_path / "run", *QUICKEST, "--likelihood", "auto") == 0
    model = content_of(tmp_path / "run", "certificate.json")["model"]
    assert model["likelihood"] == "auto"
    assert set(model["shares"]) == {"boltzmann", "placement"}
    assert sum(model["shares"].values()) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("likelihood", "spread", "median"),
    [("placement", "--noise-spread", 0.01), ("boltzmann", "--beta-spread", 100.0)],
)
def test_how_exact_the_person_is_can_be_learned(tmp_path, likelihood, spread, median):
    options = ("--likelihood", likelihood, "--num-queries", "0")
    assert start(tmp_path / "fixed", *options) == 0
    assert start(tmp_path / "learned", *options, spread, "0.5") == 0
    assert np.load(tmp_path / "fixed" / "posterior.npz")["scales"].size == 0
    scales = np.load(tmp_path / "learned" / "posterior.npz")["scales"]
    assert scales.shape == (200,)
    assert len(np.unique(scales)) > 10
    # The prior ends at two spreads.
    assert (np.abs(np.log(scales / median)) <= 2 * 0.5 + 1e-9).all()


def test_points_may_overlap_and_the_arm_leaves_them_alone(tmp_path):
    assert start(tmp_path / "run", "--num-queries", "2", "--points") == 0
    assert content_of(tmp_path / "run", "summary.json")["executions"]["attempted"] == 0
    assert {row["success"] for row in rows_of(tmp_path / "run")} == {""}
    layouts = content_of(tmp_path / "run", "certificate.json")["layouts"]
    assert layouts["distribution"] == "uniform"


def test_the_robot_acts_on_the_guess_that_was_chosen(tmp_path):
    for guess in ("map", "mean"):
        folder = tmp_path / guess
        assert start(folder, "--num-queries", "0", "--guess", guess) == 0
        posterior = np.load(folder / "posterior.npz")
        written = content_of(folder, "weights.json")
        weights = np.array(written["object_weights"] + written["table_weights"])
        np.testing.assert_array_equal(weights, posterior[f"{guess}_weights"])
        np.testing.assert_array_equal(weights, posterior["guessed_weights"])
    assert not np.array_equal(posterior["map_weights"], posterior["mean_weights"])


def test_the_teacher_errs_in_demonstrations_and_is_tested_by_what_is_wanted(tmp_path):
    """The biased one means what the exact one does, and shows it 0.05 to the right."""
    placements, rows = {}, {}
    for teacher in ("exact", "biased"):
        folder = tmp_path / teacher
        assert start(folder, "--num-queries", "0", "--teacher", teacher) == 0
        (demo,) = content_of(folder, "demonstrations.json")["demonstrations"]
        placements[teacher] = np.array(demo["placement"])
        (rows[teacher],) = rows_of(folder)
    bias = placements["biased"] - placements["exact"]
    np.testing.assert_allclose(bias, [0.05, 0.0], atol=1e-12)
    errors = [float(rows[name]["mean_placement_error"]) for name in rows]
    assert errors[0] != errors[1]


def test_samples_are_written_for_arviz_on_request(tmp_path):
    h5netcdf = pytest.importorskip("h5netcdf")
    pytest.importorskip("h5py")
    assert start(tmp_path / "run", *QUICKEST, "--netcdf", "--noise-spread", "1") == 0
    posterior = np.load(tmp_path / "run" / "posterior.npz")
    num_chains = int(posterior["num_chains"])
    with h5netcdf.File(tmp_path / "run" / "posterior.nc", "r") as file:
        weights = file["posterior"]["weights"][:]
        assert weights.shape == (num_chains, 200 // num_chains, 13)
        np.testing.assert_array_equal(weights.reshape(200, 13), posterior["weights"])
        scales = file["posterior"]["scale"][:].ravel()
        np.testing.assert_array_equal(scales, posterior["scales"])
        log_posts = file["sample_stats"]["lp"][:].ravel()
        np.testing.assert_array_equal(log_posts, posterior["log_posts"])
        assert (file.attrs["task"], file.attrs["num_demos"]) == ("vase", 2)
