import sys

import numpy as np
import pytest

from tablesetting import __version__
from tablesetting.errors import OutputError
from tablesetting.irl.netcdf import save_netcdf


def chains():
    rng = np.random.default_rng(0)
    return rng.standard_normal((4, 50, 3)), rng.standard_normal((4, 50))


@pytest.mark.parametrize("missing", ["h5netcdf", "h5py"])
def test_without_the_extra_the_error_names_the_remedy(tmp_path, monkeypatch, missing):
    for module in ("h5netcdf", "h5py"):
        monkeypatch.setitem(sys.modules, module, type(sys)(module))
    monkeypatch.setitem(sys.modules, missing, None)
    weights, log_posts = chains()
    remedy = rf"without {missing}; run: pip install 'tablesetting\[arviz\]'"
    with pytest.raises(OutputError, match=remedy):
        save_netcdf(tmp_path / "posterior.nc", {"weights": weights}, {"lp": log_posts})


def test_the_file_follows_the_schema(tmp_path):
    h5netcdf = pytest.importorskip("h5netcdf")
    weights, log_posts = chains()
    path = tmp_path / "posterior.nc"
    save_netcdf(
        path, {"weights": weights}, {"lp": log_posts}, {"task": "vase", "num_demos": 3}
    )
    with h5netcdf.File(path, "r") as file:
        posterior, stats = file["posterior"], file["sample_stats"]
        assert posterior["weights"].dimensions == ("chain", "draw", "weight")
        assert stats["lp"].dimensions == ("chain", "draw")
        np.testing.assert_array_equal(posterior["weights"][:], weights)
        np.testing.assert_array_equal(stats["lp"][:], log_posts)
        np.testing.assert_array_equal(stats["draw"][:], np.arange(50))
        assert posterior.attrs["creation_library"] == "tablesetting"
        assert posterior.attrs["creation_library_version"] == __version__
        assert (file.attrs["task"], stats.attrs["num_demos"]) == ("vase", 3)


def test_an_earlier_file_is_replaced(tmp_path):
    h5netcdf = pytest.importorskip("h5netcdf")
    weights, log_posts = chains()
    path = tmp_path / "posterior.nc"
    save_netcdf(path, {"weights": weights}, {"lp": log_posts})
    save_netcdf(path, {"weights": weights[:, :20]}, {})
    with h5netcdf.File(path, "r") as file:
        assert file["posterior"]["weights"].shape == (4, 20, 3)
        assert not file["sample_stats"].variables


# ArviZ warns of what will change in it.
@pytest.mark.filterwarnings("ignore")
def test_arviz_reads_the_file_back(tmp_path):
    arviz = pytest.importorskip("arviz")
    weights, log_posts = chains()
    path = tmp_path / "posterior.nc"
    save_netcdf(path, {"weights": weights}, {"lp": log_posts})
    data = arviz.from_netcdf(path)
    assert data.posterior["weights"].dims == ("chain", "draw", "weight")
    np.testing.assert_array_equal(data.posterior["weights"], weights)
    np.testing.assert_array_equal(data.sample_stats["lp"], log_posts)
    assert data.posterior.attrs["creation_library"] == "tablesetting"
    assert len(arviz.summary(data)) == 3
