"""How commands stop at a signal: at once, or when they are ready, and never with a traceback."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

HEAD = """
import os, signal, subprocess, sys, time
from simloop.cli.stopping import leaving_at_once, leaves_at_once, stopping
"""
INTERRUPTED = 130


def run(body, *signals):
    """Run a program that prints 'ready', and send it the signals half a second apart."""
    process = subprocess.Popen(
        [sys.executable, "-c", HEAD + body],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    first = process.stdout.readline()
    for one in signals:
        process.send_signal(one)
        time.sleep(0.3)
    out, error = process.communicate(timeout=30)
    return process.returncode, first + out, error


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_command_that_keeps_nothing_ends_at_once(number):
    # KeyboardInterrupt would become another error here, as in an import or a compiled kernel.
    body = """
@leaves_at_once
def command():
    print("ready", flush=True)
    try:
        time.sleep(30)
    except KeyboardInterrupt:
        raise ImportError("initialization failed")
command()
"""
    assert run(body, number) == (INTERRUPTED, "ready\n", "interrupted\n")


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="reads /proc")
def test_its_own_children_end_and_no_other_process():
    bystander = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    body = """
with leaving_at_once():
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    print(child.pid, flush=True)
    time.sleep(30)
"""
    try:
        code, out, error = run(body, signal.SIGTERM)
        assert (code, error) == (INTERRUPTED, "interrupted\n")
        until = time.monotonic() + 5.0
        while Path(f"/proc/{int(out)}").exists() and time.monotonic() < until:
            state = Path(f"/proc/{int(out)}/stat").read_text().rpartition(")")[2].split()[0]
            if state == "Z":
                break
            time.sleep(0.02)
        else:
            assert not Path(f"/proc/{int(out)}").exists()
        assert bystander.poll() is None
    finally:
        bystander.kill()
        bystander.wait()


def test_a_first_signal_is_asked_for_and_a_second_ends_the_process():
    body = """
with stopping("stopping: once more to end at once") as stop:
    print("ready", flush=True)
    until = time.monotonic() + 10
    while time.monotonic() < until and not (stop() and len(sys.argv) > 5):
        time.sleep(0.01)
print("not reached")
"""
    code, out, error = run(body, signal.SIGINT, signal.SIGTERM)
    assert (code, out) == (INTERRUPTED, "ready\n")
    assert error == "stopping: once more to end at once\ninterrupted\n"
    body = body.replace(" and len(sys.argv) > 5", "").replace("not reached", "kept")
    assert run(body, signal.SIGINT) == (0, "ready\nkept\n", "stopping: once more to end at once\n")


def test_the_handlers_of_before_are_back_afterwards():
    from simloop.cli.stopping import leaving_at_once, stopping

    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with leaving_at_once(), stopping("") as stop:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.01)
        assert stop()
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before
