import io

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from tablesetting.curves import Curve, CurveKey
from tablesetting.plotting import (
    WorstLayout,
    plot_calibration,
    plot_execution,
    plot_learning,
    plot_placement_study,
    plot_query,
    plot_validation,
)

ROWS = [
    {
        "num_demos": str(count),
        "mean_placement_error": str(0.3 / count),
        "max_placement_error": str(0.6 / count),
        "var_bound": "" if count == 3 else str(0.9 / count),
        "deployment_bound": "inf" if count == 1 else str(1.2 / count),
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
    bound = lines["bound over the deployment"].get_ydata()
    np.testing.assert_allclose(bound, [np.inf, 0.6, 0.4])
    assert np.isfinite(axes.get_ylim()).all()
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


def curve(*means):
    steps = np.arange(1.0, len(means) + 1)
    return Curve(steps, np.array(means), np.full(len(means), 0.1), 4)


def study_curves(scale):
    """Return curves of two tasks and strategies; the spoon's errors are twice as large."""
    return {
        CurveKey(task, strategy, quantity): curve(3 * level, 2 * level)
        for task, size in (("vase", 1.0), ("spoon", 2.0))
        for strategy, gain in (("active-var", 1.0), ("random", 1.5))
        for quantity, level in (
            ("mean_placement_error", scale * size * gain * 0.1),
            ("max_placement_error", scale * size * gain * 0.2),
            ("var_bound", scale * size * gain * 0.4),
        )
    }


def test_a_study_is_drawn_as_the_papers_figure_with_its_curves_behind():
    published = study_curves(1.1)
    del published[CurveKey("vase", "random", "mean_placement_error")]
    figure = plot_placement_study(study_curves(1.0), published, "4 trials")
    vase_means, spoon_means, vase_bounds, spoon_bounds = figure.axes
    assert vase_means.get_title() == "place vase"
    assert spoon_means.get_title() == "place spoon"
    labels = set(vase_means.get_legend_handles_labels()[1])
    assert labels == {"active-var", "active-var (paper)", "random"}
    labels = set(spoon_bounds.get_legend_handles_labels()[1])
    for name in ("0.95-VaR bound", "largest error", "mean error"):
        assert {f"active-var, {name}", f"active-var, {name} (paper)"} <= labels
    behind = drawn_lines(vase_bounds)["active-var, 0.95-VaR bound (paper)"]
    np.testing.assert_allclose(behind.get_ydata(), [1.32, 0.88])
    ours = [container for container in spoon_means.containers]
    np.testing.assert_allclose(ours[1].lines[0].get_ydata(), [0.9, 0.6])
    for axes in figure.axes:
        assert axes.get_ylim()[0] == 0.0
        assert "table units" in axes.get_ylabel()
    assert figure.get_suptitle() == "4 trials"


def test_a_study_of_one_task_and_strategy_has_one_column():
    key = CurveKey("vase", "random", "mean_placement_error")
    figure = plot_placement_study({key: curve(0.3, 0.2)}, {}, "1 trial")
    assert len(figure.axes) == 2
    labels = figure.axes[1].get_legend_handles_labels()[1]
    assert labels == ["random, mean error"]


def test_a_long_title_stays_on_the_figure():
    key = CurveKey("vase", "random", "mean_placement_error")
    title = ", ".join(["likelihood boltzmann", "target ess 200.0"] * 5)
    figure = plot_placement_study({key: curve(0.3, 0.2)}, {}, title)
    FigureCanvasAgg(figure).draw()
    (text,) = figure.texts
    extent = text.get_window_extent()
    assert figure.bbox.x0 <= extent.x0
    assert extent.x1 <= figure.bbox.x1
    assert text.get_text().replace("\n", " ") == title


CALIBRATED = [
    (kind, num_demos, share, share - 0.05, share + 0.02)
    for kind, share in (("exact", 0.97), ("noisy", 0.9), ("biased", 0.3), ("me", 0.8))
    for num_demos in (1, 2)
]


def test_calibration_is_drawn_by_kind_with_what_was_promised():
    figure = plot_calibration(CALIBRATED, 0.95, "4 preferences")
    *panels, empty, last = figure.axes
    assert [axes.get_title() for axes in panels[:4]] == [
        "exact",
        "noisy",
        "biased",
        "me",
    ]
    assert not empty.axison
    assert not last.axison
    for axes, share in zip(panels, (0.97, 0.9, 0.3, 0.8), strict=True):
        found, promised = axes.get_lines()
        np.testing.assert_array_equal(found.get_xdata(), [1, 2])
        np.testing.assert_array_equal(found.get_ydata(), [share, share])
        assert list(promised.get_ydata()) == [0.95, 0.95]
        low, high = axes.get_ylim()
        assert low < share < high
    assert figure.get_suptitle() == "4 preferences"


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_figures_can_be_saved_without_a_display(tmp_path, suffix):
    reward_map = np.zeros((4, 4))
    for figure in (
        plot_learning(ROWS, "vase"),
        plot_query(reward_map, {}, MARKED, "query 1"),
        plot_placement_study(study_curves(1.0), study_curves(1.1), "4 trials"),
        plot_calibration(CALIBRATED, 0.95, "4 preferences"),
    ):
        figure.savefig(tmp_path / f"figure{suffix}")
        assert (tmp_path / f"figure{suffix}").stat().st_size > 1000


def executed(goal, error_mm, success="1", task="spoon"):
    """A row of an execution study."""
    place = {"x": "0.4", "y": "0.6"} if error_mm else {"x": "0.1", "y": "0.2"}
    names = {"task": task, "goal": goal, "error_mm": error_mm, "success": success}
    return names | place


def test_executions_are_drawn_by_error_and_by_place():
    rows = [
        *[executed("table", error) for error in ("0.1", "0.3", "0.2")],
        executed("bowl", "2.0"),
        executed("bowl", "", success="0"),
    ]
    figure = plot_execution(rows, "5 layouts")
    shares, table, bowl, bar = figure.axes
    assert [line.get_label() for line in shares.lines] == [
        "spoon, table",
        "spoon, bowl",
    ]
    np.testing.assert_allclose(shares.lines[0].get_xdata(), [0.1, 0.2, 0.3])
    np.testing.assert_allclose(shares.lines[0].get_ydata(), [1 / 3, 2 / 3, 1.0])
    assert (table.get_title(), bowl.get_title()) == ("spoon, table", "spoon, bowl")
    np.testing.assert_allclose(table.collections[0].get_offsets(), 3 * [[0.4, 0.6]])
    assert not table.lines
    (cross,) = bowl.lines
    assert (*cross.get_xdata(), *cross.get_ydata()) == (0.1, 0.2)
    assert bar.get_ylabel() == "error [mm]"


@pytest.mark.parametrize("rows", [[], [executed("table", "", success="0")]])
def test_executions_are_drawn_even_if_there_are_none(rows):
    figure = plot_execution(rows, "1 layouts")
    FigureCanvasAgg(figure).draw()
    assert len(figure.axes) >= 1 + bool(rows)


def test_validated_weights_are_drawn_on_one_scale_and_in_one_window():
    wanted = np.array([[0.5, 0.5], [0.4, 0.6]])
    worst = WorstLayout("layout 1", {"cup": np.array([[0.1, 0.2]])}, *wanted)
    validated = [
        ("a$b$", wanted + 0.01, np.array([0.01, 0.02]), [worst]),
        ("none", wanted, np.zeros(2), []),
    ]
    figure = plot_validation(wanted, validated, "against $x$")
    first, second = (axes for axes in figure.axes if axes.get_ylabel().startswith("y"))
    for axes in (first, second):
        (points,) = (each for each in axes.collections if each.get_array() is not None)
        assert (points.norm.vmin, points.norm.vmax) == (0.0, 0.02)
        assert axes.get_xlim() == first.get_xlim()
        assert axes.get_ylim() == first.get_ylim()
    figure.savefig(io.BytesIO())  # Where no dollar starts a formula.
