"""How computations yield: to other processes of their session, and as a session to others."""

import os
import subprocess
import sys
from pathlib import Path
from unittest import mock

from stridelab.service.processes import priority

ASK = """
import os
from stridelab.service.processes.priority import lower_priority
lower_priority()
print(os.nice(0))
"""


def test_a_process_and_its_session_are_nicer() -> None:
    group = Path("/proc/self/autogroup")
    program = f"{ASK}print(open({str(group)!r}).read())" if group.exists() else ASK
    run = subprocess.run(
        [sys.executable, "-c", f"import os; os.nice(-os.nice(0)) if os.geteuid() == 0 else None\n{program}"],
        start_new_session=True,
        capture_output=True,
        text=True,
        check=True,
    )
    nice, *session = run.stdout.split("\n", 1)
    assert int(nice) >= priority.NICENESS
    assert not group.exists() or f"nice {priority.NICENESS}" in session[0]


def test_refused_calls_to_the_kernel_are_repeated_a_few_times_only() -> None:
    group, refused = mock.Mock(spec=Path), BlockingIOError()
    with mock.patch("time.sleep") as slept:
        group.write_text.side_effect = [refused, refused, 2]
        priority.lower_session_priority(group=group)
        assert [call.args[0] for call in slept.call_args_list] == [0.05, 0.1]
        group.write_text.side_effect = refused
        priority.lower_session_priority(group=group)
        group.write_text.side_effect = FileNotFoundError()
        priority.lower_session_priority(group=group)
    assert group.write_text.call_count == 3 + 4 + 1


def test_without_permission_a_live_process_keeps_its_rank() -> None:
    with mock.patch("os.setpriority", side_effect=PermissionError()) as setpriority:
        priority.raise_priority()
    setpriority.assert_called_once_with(os.PRIO_PROCESS, 0, priority.LIVE_NICENESS)
