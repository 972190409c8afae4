"""Learn one task actively while the arm acts on the current best guess."""

from collections.abc import Generator, Iterator
from dataclasses import replace

from tablesetting.experiments.arm import Arm, Attempt
from tablesetting.experiments.config import RunConfig
from tablesetting.experiments.episodes import Episode, keep
from tablesetting.experiments.learning import LearningRound, learn
from tablesetting.experiments.rounds import RunRound, execution_view, round_view
from tablesetting.experiments.run_files import RunFiles
from tablesetting.experiments.setup import RunSetup, arm_rng
from tablesetting.recording import RunCard, RunRecorder
from tablesetting.results import RECORDING, SUMMARY, RunFolder, package_versions
from tablesetting.scene.scene import Snapshot


def run(
    config: RunConfig, setup: RunSetup, folder: RunFolder
) -> Generator[RunRound, None, None]:
    """Carry out a run, and write its folder as it goes, from the start.

    Whatever is finished when the caller stops stays readable; the summary comes with
    the last round.

    Args:
        config: The options.
        setup: What they resolve to.
        folder: A run folder with its config.json.

    Yields:
        One round per number of demonstrations, when the arm is done with it.
    """
    task = setup.problem.task
    folder.remove_results()
    files = RunFiles(folder, config, setup)
    arm = Arm(task.objects, task.item, config.arm)
    card = RunCard(
        task=task.name,
        strategy=config.strategy,
        seed=config.seed,
        objects=task.objects,
        item=task.item,
        versions=package_versions(),
    )
    recording_id = f"{task.name}-{config.preset}-{config.strategy}-{config.seed}"
    with RunRecorder(
        folder.path / RECORDING, arm.scene.model, card, recording_id=recording_id
    ) as recorder:
        for latest in _learn(config, setup, arm, recorder, folder):
            files.add(latest)
            if latest.stopped is not None:
                summary = files.summarize(latest.stopped)
                recorder.log_summary(summary)
                break
            yield latest
    folder.write_json(SUMMARY, summary)  # Last: who finds it finds all.
    yield latest


def _learn(
    config: RunConfig,
    setup: RunSetup,
    arm: Arm,
    recorder: RunRecorder,
    folder: RunFolder,
) -> Iterator[RunRound]:
    """Learn until the budget is spent or the bound is small, on request certified so."""
    problem = setup.problem
    for num_asked, state in enumerate(learn(setup, config.strategy)):
        latest = _evaluate(
            state,
            setup,
            is_enough=state.is_certain
            and not (config.require_certificate and state.doubts),
            is_last=num_asked == config.num_queries,
        )
        recorder.log_round(round_view(latest, problem, config.strategy))
        if latest.stopped is None and num_asked < setup.num_executions:
            attempt = _act(state, setup, arm, recorder, folder)
            latest = replace(latest, attempt=attempt)
        else:
            arm.scene.lay(state.learning.query)
            recorder.show(arm.scene.snapshot())
        yield latest
        if latest.stopped is not None:
            return


def _evaluate(
    state: LearningRound, setup: RunSetup, *, is_enough: bool, is_last: bool
) -> RunRound:
    problem, query = setup.problem, state.learning.query
    guess = state.learning.posterior.guessed_weights
    return RunRound(
        state=state,
        placement=problem.best_placements(guess[None], query[None])[0, 0],
        truth=problem.wishes(query[None])[0],
        free_truth=problem.free_wish(query),
        stopped="epsilon" if is_enough else "budget" if is_last else None,
    )


def _act(
    state: LearningRound,
    setup: RunSetup,
    arm: Arm,
    recorder: RunRecorder,
    folder: RunFolder,
) -> Attempt:
    """Let the arm put the item where the best guess wants it and it fits."""
    learning, kept = state.learning, list[Snapshot]()
    best_guess = learning.posterior.guessed_weights
    target = setup.problem.best_free_placement(best_guess, learning.query)
    rng = arm_rng(setup.arm_seeds, state.num_demos)
    attempt = arm.place(learning.query, target, keep(recorder.record, kept), rng=rng)
    if attempt.is_refused:
        recorder.show(arm.scene.snapshot())
    if kept:
        episode = Episode.of_snapshots(learning.query, target, kept)
        episode.save(folder, state.num_demos)
    recorder.log_execution(execution_view(attempt))
    return attempt
