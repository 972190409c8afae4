import pytest
import quick_cli


@pytest.fixture(scope="session")
def vase_run(tmp_path_factory):
    """A run of two queries with short chains; the arm acts in both."""
    folder = tmp_path_factory.mktemp("runs") / "vase"
    assert quick_cli.start(folder, "--num-queries", "2", "--seed", "5") == 0
    return folder
