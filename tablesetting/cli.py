"""Learn where a person wants things on a table, and bound how wrong that is."""

import contextlib
import os
import shlex
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from tablesetting.command_line import (
    FAILED,
    follow_trials,
    new_folder,
    num_cores,
    parse,
    program,
    resume_advice,
    run_command,
    telling_why_it_stops,
)
from tablesetting.errors import InvalidFile
from tablesetting.experiments.config import (
    DoctorConfig,
    ExportConfig,
    InspectConfig,
    LearnConfig,
    ReplayConfig,
    RunConfig,
    ValidateConfig,
)
from tablesetting.experiments.study_config import (
    STUDIES,
    CalibrationStudyConfig,
    ExecutionStudyConfig,
    PlacementStudyConfig,
    StudyConfig,
    TrialsConfig,
)
from tablesetting.options import changed_options

# Nothing is rendered in this process, and without a display the default would warn.
os.environ.setdefault("MUJOCO_GL", "disable")
# The matrices are small: a second thread would only spin.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The packages behind a command take a second or more to import: each command does so
# itself, so that --help and mistakes are answered at once.


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: Arguments after the program's name; those of the process if None.

    Returns:
        The exit code: 0, 1 (the work failed), 2 (bad input) or 130 (interrupted).
    """
    commands: dict[type, Callable[..., int]] = {
        RunConfig: _run,
        LearnConfig: _learn,
        ValidateConfig: _validate,
        PlacementStudyConfig: _study,
        CalibrationStudyConfig: _study,
        ExecutionStudyConfig: _study,
        InspectConfig: _inspect,
        ReplayConfig: _replay,
        ExportConfig: _export,
        DoctorConfig: _doctor,
    }

    def command() -> int:
        config = _parse(list(sys.argv[1:] if argv is None else argv))
        return commands[type(config)](config)

    return run_command(command)


def _parse(arguments: Sequence[str]) -> object:
    prog, description = "tablesetting", __doc__ or ""
    configs: dict[str, Callable[..., object]] = {
        "run": RunConfig,
        "learn": LearnConfig,
        "validate": ValidateConfig,
        "study": StudyConfig,
        "inspect": InspectConfig,
        "replay": ReplayConfig,
        "export": ExportConfig,
        "doctor": DoctorConfig,
    }
    if arguments[:1] == ["study"]:
        prog, description = "tablesetting study", StudyConfig.__doc__ or ""
        configs, arguments = dict(STUDIES), arguments[1:]
    return parse(arguments, configs, prog=prog, description=description)


def _run(config: RunConfig) -> int:
    # What Rerun would log of a failure is told by our own errors.
    os.environ.setdefault("RUST_LOG", "off")
    from tqdm import tqdm

    from tablesetting.experiments.run import run
    from tablesetting.experiments.run_files import run_settings
    from tablesetting.experiments.setup import RunSetup
    from tablesetting.irl.netcdf import require_netcdf
    from tablesetting.opening import open_folder
    from tablesetting.results import RECORDING, SUMMARY, load_json

    setup = RunSetup.of_config(config)
    out = config.out or new_folder(Path("runs", "run"), config.task)
    if config.netcdf:
        require_netcdf(out / "posterior.nc")
    opened = open_folder(
        out,
        run_settings(config, setup),
        resume=config.resume,
        overwrite=config.overwrite,
    )
    num_rounds, doubts = 0, list[str]()

    def progress() -> str:
        return f"{num_rounds} finished round{'s' * (num_rounds != 1)} in {out}"

    with opened as folder:
        if config.resume and (out / SUMMARY).exists():
            summary = load_json(out / SUMMARY)
            is_certified = (
                isinstance(summary, dict) and summary.get("certified") is True
            )
            print(f"finished already, {'' if is_certified else 'not '}certified: {out}")
            return 0 if is_certified or not config.require_certificate else FAILED
        with telling_why_it_stops(progress):
            _load_kernels()
            with (
                contextlib.closing(run(config, setup, folder)) as rounds,
                tqdm(total=config.num_queries + 1, unit="round", disable=None) as bar,
            ):
                for latest in rounds:
                    num_rounds += 1
                    doubts = latest.state.doubts if latest.stopped else []
                    bar.update()
                    bar.write(latest.describe())
    print("not certified:" if doubts else "certified: see certificate.json")
    for doubt in doubts:
        print(f"  {doubt}")
    share = latest.state.share_within_epsilon
    print(f"in truth: error below {setup.epsilon:g} in {share:.0%} of the test layouts")
    recording = out / RECORDING
    print(f"recording: {recording} ({recording.stat().st_size / 1e6:.1f} MB)")
    print(
        f"open it with: {shlex.join([*program('tablesetting'), 'inspect', str(out)])}"
    )
    return FAILED if doubts and config.require_certificate else 0


def _learn(config: LearnConfig) -> int:
    # What Rerun would log of a failure is told by our own errors.
    os.environ.setdefault("RUST_LOG", "off")
    from tqdm import tqdm

    from tablesetting.experiments.learn import append_to_session, open_session
    from tablesetting.experiments.learn_story import tell_learned

    if config.append is not None:
        out, opened = config.demos, append_to_session(config)
        advice = "give the same command and --resume"
    else:
        out = config.out or new_folder(Path("runs", "learn"), config.demos.stem)
        opened, advice = open_session(config, out), resume_advice(out)
    with opened as session:
        num_demos = len(session.setup.demos)
        kept = (
            f"{num_demos} demonstrations are kept in {shlex.quote(str(out))}; {advice}"
        )
        with telling_why_it_stops(lambda: kept):
            _load_kernels()
            with (
                contextlib.closing(session.learn()) as rounds,
                tqdm(total=num_demos, unit="demonstration", disable=None) as bar,
            ):
                for latest in rounds:
                    bar.update(latest.num_demos - bar.n)
    print(*tell_learned(latest, out), sep="\n")
    again = [*program("tablesetting"), "learn", str(out), "--append", "next", "X,Y"]
    print(f"learn from the answer with: {shlex.join(again)}")
    return 0


def _validate(config: ValidateConfig) -> int:
    from tqdm import tqdm

    from tablesetting.experiments.validate import Validation
    from tablesetting.experiments.validation_files import (
        finish_validation,
        write_validation,
    )
    from tablesetting.opening import open_folder

    validation = Validation.of_config(config)
    out = config.out or new_folder(Path("runs", "validate"), validation.task.name)
    opened = open_folder(
        out,
        validation.settings(),
        resume=config.resume,
        overwrite=config.overwrite,
    )
    num_done, num_ordered = 0, config.execute * len(validation.rewards)

    def progress() -> str:
        return (
            f"{num_done} of {num_ordered} executions are in {shlex.quote(str(out))}; "
            f"{resume_advice(out)}"
        )

    with opened as folder, telling_why_it_stops(progress):
        num_jobs = config.jobs or num_cores()
        is_quiet = None if num_ordered else True
        with (
            contextlib.closing(
                write_validation(validation, folder, num_jobs)
            ) as counts,
            tqdm(total=num_ordered, unit="placement", disable=is_quiet) as bar,
        ):
            for num_done in counts:
                bar.update(num_done - bar.n)
        lines = finish_validation(validation, folder)
    print(*lines, sep="\n")
    return 0


def _study(config: TrialsConfig) -> int:
    from tablesetting.experiments.study import finish_study, run_study
    from tablesetting.experiments.study_files import StudyFolder

    out = config.out or new_folder(Path("runs", "study"), config.name)
    is_merge = config.merge is not None
    open_study = StudyFolder.merge if is_merge else StudyFolder.open
    with open_study(config, out) as study:
        num_before, num_trials = len(study.rows), study.num_trials

        def progress() -> str:
            advice = "merge again, with --overwrite" if is_merge else resume_advice(out)
            return (
                f"{len(study.rows)} of {num_trials} trials are in "
                f"{shlex.quote(str(out))}; {advice}"
            )

        with telling_why_it_stops(progress):
            if study.unfinished:
                _load_kernels()  # Lest every process compile them.
            trials = run_study(study, config.jobs or num_cores())
            follow_trials(trials, num_before, num_trials)
            lines = finish_study(study)
    print(*lines, sep="\n")
    return 0


def _load_kernels() -> None:
    """Load the compiled code; say so if the wait is for a compiler."""
    from tablesetting.reward.problem import load_kernels

    message = "compiling, for the first use of this installation; some seconds"
    timer = threading.Timer(1.5, print, [message], {"file": sys.stderr})
    timer.start()
    try:
        load_kernels()
    finally:
        timer.cancel()


def _inspect(config: InspectConfig) -> int:
    from tablesetting.experiments.listing import list_runs
    from tablesetting.recording.screenshot import screenshot
    from tablesetting.recording.story import end_of_round, tell
    from tablesetting.recording.viewer import view
    from tablesetting.results import CONFIG, RECORDING

    is_run = any((config.run / name).exists() for name in (CONFIG, RECORDING))
    if config.run.is_dir() and not is_run:
        if given := changed_options(config, InspectConfig(config.run)):
            raise InvalidFile(
                f"'{config.run}' is no run, though it may hold some; name one, or leave "
                f"out {', '.join(given)}"
            )
        print(*list_runs(config.run), sep="\n")
        return 0
    recording = config.run / RECORDING if config.run.is_dir() else config.run
    if config.screenshot is not None:
        at = config.at
        if config.query is not None:
            at = end_of_round(recording, config.query)
        screenshot(recording, config.screenshot, at)
        print(f"wrote {config.screenshot}")
        return 0
    # Refuses what is not a recording, for the viewer, too.
    story = tell(recording, config.query)
    if config.text or config.query is not None:
        print(story)
        return 0
    view(recording, in_browser=config.web)


def _replay(config: ReplayConfig) -> int:
    from tablesetting.experiments.replay import replay

    found = replay(config.run, config.query)
    print(found.tell())
    return 0 if found.is_same else FAILED


def _export(config: ExportConfig) -> int:
    from tablesetting.experiments.export import export

    run = config.run.resolve()
    out = config.out or run.with_name(f"{run.name}-{config.to}")
    export(config.run, config.to, out, overwrite=config.overwrite)
    print(f"wrote {out}")
    return 0


def _doctor(config: DoctorConfig) -> int:
    from tablesetting.experiments.doctor import diagnose

    is_well = True
    for finding in diagnose(config.out):
        is_well &= finding.is_well
        mark = "ok  " if finding.is_well else "FAIL"
        print(f"{mark}  {finding.subject:<22} {finding.detail}", flush=True)
        if finding.remedy is not None:
            print(f"      {'':<22} -> {finding.remedy}")
    return 0 if is_well else FAILED
