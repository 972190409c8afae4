import numpy as np
import pytest

from tablesetting.plotting import plot_learning, plot_query

ROWS = [
    {
        "num_demos": str(count),
        "mean_placement_error": str(0.3 / count),
        "max_placement_error": str(0.6 / count),
        "var_bound": "" if count == 3 else str(0.9 / count),
    }
    for count in (1, 2, 3)
]


def drawn_lines(axes):
    return {line.get_label(): line for line in axes.get_lines()}


def test_learning_is_drawn_over_the_number_of_demonstrations():
    (axes,) = plot_learning(ROWS, "vase").axes
    lines = drawn_lines(axes)
    mean = lines["mean error, test layouts"]
    np.testing.assert_array_equal(mean.get_xdata(), [1, 2, 3])
    np.testing.assert_allclose(mean.get_ydata(), [0.3, 0.15, 0.1])
    np.testing.assert_allclose(
        lines["largest error, test layouts"].get_ydata(), [0.6, 0.3, 0.2]
    )
    np.testing.assert_allclose(
        lines["0.95-VaR, worst candidate"].get_ydata(), [0.9, 0.45, np.nan]
    )
    assert axes.get_title() == "vase"
    assert "table units" in axes.get_ylabel()
    assert axes.get_ylim()[0] == 0.0


MARKED = {
    "robot's wish": np.array([0.4, 0.5]),
    "person's wish": np.array([0.6, 0.7]),
}


def test_query_is_drawn_with_y_up_and_what_is_marked():
    reward_map = np.arange(16.0).reshape(4, 4)
    outlines = {
        "plate": np.array([[0.1, 0.1], [0.3, 0.1], [0.2, 0.3]]),
        "cup": np.array([[0.7, 0.8]]),
    }
    figure = plot_query(reward_map, outlines, MARKED, "query 1")
    axes = figure.axes[0]
    (image,) = axes.get_images()
    assert image.origin == "lower"
    assert tuple(image.get_extent()) == (0, 1, 0, 1)
    np.testing.assert_array_equal(image.get_array(), reward_map)
    lines = drawn_lines(axes)
    for name, place in MARKED.items():
        assert lines[name].get_xydata().tolist() == [place.tolist()]
    written = {text.get_text(): text.xy for text in axes.texts}
    assert written["cup"] == pytest.approx((0.7, 0.8))
    assert written["plate"] == pytest.approx((0.2, 0.5 / 3))


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_figures_can_be_saved_without_a_display(tmp_path, suffix):
    reward_map = np.zeros((4, 4))
    for figure in (
        plot_learning(ROWS, "vase"),
        plot_query(reward_map, {}, MARKED, "query 1"),
    ):
        figure.savefig(tmp_path / f"figure{suffix}")
        assert (tmp_path / f"figure{suffix}").stat().st_size > 1000
