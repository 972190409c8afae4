"""What a run looks like in Rerun: a recorder, and ways to look at its file."""

from tablesetting.recording.recorder import RunRecorder as RunRecorder
from tablesetting.recording.views import ExecutionView as ExecutionView
from tablesetting.recording.views import RoundView as RoundView
from tablesetting.recording.views import RunCard as RunCard
