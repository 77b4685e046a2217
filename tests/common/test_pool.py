"""The runner of many work items: crashes, stops, and whose processes end on an interrupt."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, get_context
from pathlib import Path

import pytest

from simloop.common.pool import Workers, local_workers, run_all


def no_loss(item):
    raise AssertionError(f"item {item} was lost")


def square(number):
    return number * number


def fail_at_two(number):
    if number == 2:
        raise ValueError("two")
    return number


def die_at_two(number):
    if number == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die_late_at_two(number):
    time.sleep(0.5 if number == 2 else 0.0)  # longer than the runner waits at a time
    return die_at_two(number)


def die_at_first_try(marker):
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return marker.name


def sleep_long(number):
    time.sleep(60.0 if number else 0.0)
    return number


@pytest.fixture
def bystander():
    """Another child process of this one, with which the runner has nothing to do."""
    process = get_context("spawn").Process(target=time.sleep, args=(120.0,))
    process.start()
    yield process
    process.kill()
    process.join()


def own_workers(bystander):
    return [p for p in active_children() if p.pid != bystander.pid]


def wait_until(condition, seconds=20.0):
    until = time.monotonic() + seconds
    while not condition() and time.monotonic() < until:
        time.sleep(0.02)
    assert condition()


def test_every_item_has_its_result():
    found = dict(run_all(range(20), square, local_workers(2), when_lost=no_loss))
    assert found == {number: number * number for number in range(20)}


def test_few_items_are_handed_out_ahead():
    handed = []
    runner = run_all(range(100), square, Workers(lambda: Counting(handed), 1), when_lost=no_loss)
    for count, _ in enumerate(runner, start=1):
        assert len(handed) <= count + 2
    assert len(handed) == 100


class Counting(ThreadPoolExecutor):
    def __init__(self, handed):
        super().__init__(1)
        self._handed = handed

    def submit(self, work, item):
        self._handed.append(item)
        return super().submit(work, item)


def test_an_item_that_kills_its_worker_is_given_up_alone():
    lost = []
    found = dict(
        run_all(
            range(6),
            die_at_two,
            local_workers(2),
            when_lost=lambda item: lost.append(item) or "lost",
        )
    )
    assert lost == [2]
    assert found == {0: 0, 1: 1, 2: "lost", 3: 3, 4: 4, 5: 5}


def test_the_last_item_is_given_up_however_late_it_kills_its_worker():
    made = []

    def make_pool():
        assert len(made) < 5, "the item is tried again and again"
        made.append(local_workers(1).make_pool())
        return made[-1]

    found = dict(
        run_all(range(3), die_late_at_two, Workers(make_pool, 1), when_lost=lambda item: "lost")
    )
    assert found == {0: 0, 1: 1, 2: "lost"}


def test_an_item_whose_worker_died_once_is_tried_again(tmp_path: Path):
    # It is the only item, so no other item can be suspected: it has a second try all the same.
    items = [tmp_path / "tried"]
    found = list(run_all(items, die_at_first_try, local_workers(1), when_lost=no_loss))
    assert found == [(items[0], "tried")]


class BrokenAtSubmit(ThreadPoolExecutor):
    def submit(self, *_):
        raise BrokenProcessPool("a worker died while it had nothing to do")


def test_a_pool_that_broke_between_two_items_is_made_anew():
    pools = iter([BrokenAtSubmit(1), ThreadPoolExecutor(1)])
    found = dict(run_all([3], square, Workers(lambda: next(pools), 1), when_lost=no_loss))
    assert found == {3: 9}


def test_an_error_of_the_work_goes_to_the_caller():
    runner = run_all(range(6), fail_at_two, local_workers(1), when_lost=no_loss)
    with pytest.raises(ValueError, match="two"):
        list(runner)


@pytest.mark.parametrize("interrupt", [KeyboardInterrupt, GeneratorExit])
def test_an_interrupt_ends_the_own_workers_and_no_other_process(bystander, interrupt):
    runner = run_all([0, 1, 2, 3], sleep_long, local_workers(2), when_lost=no_loss)
    assert next(runner) == (0, 0)
    assert own_workers(bystander)
    with pytest.raises(interrupt):
        runner.throw(interrupt)
    wait_until(lambda: not own_workers(bystander))
    assert bystander.is_alive()


def report_and_sleep(folder):
    (folder / f"{os.getpid()}.worker").touch()
    time.sleep(120.0)


def run_for_ever(folder):
    list(run_all([folder, folder], report_and_sleep, local_workers(2), when_lost=no_loss))


def is_gone(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    # A process that nobody has waited for is a zombie: it holds nothing.
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="reads /proc")
def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path):
    parent = get_context("spawn").Process(target=run_for_ever, args=(tmp_path,))
    parent.start()
    wait_until(lambda: len(list(tmp_path.iterdir())) == 2)
    parent.kill()
    parent.join()
    wait_until(lambda: all(is_gone(int(one.stem)) for one in tmp_path.iterdir()), 10.0)


def test_a_worker_notices_the_end_of_its_parent_without_the_kernels_help(tmp_path: Path):
    code = (
        "import multiprocessing, time\n"
        "from simloop.common import pool\n"
        "multiprocessing.parent_process = lambda: type('Gone', (), {'join': lambda self: None})()\n"
        "pool._end_with_parent()\n"
        "print('still here')\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ran.returncode, ran.stdout) == (1, "")


def test_a_stop_may_drop_what_has_started():
    handed = []
    runner = run_all(
        [0, 1],
        sleep_long,
        local_workers(1),
        when_lost=no_loss,
        stop=lambda: bool(handed),
        finish_started=False,
    )
    for item, _ in runner:
        handed.append(item)
    assert handed == [0]
    wait_until(lambda: not active_children())


def test_a_worker_does_not_hear_ctrl_c_while_it_starts():
    # The signal goes to the whole group, as from a terminal, before a worker has its first item.
    code = (
        "import os, signal, threading\n"
        "from simloop.common.pool import local_workers, run_all\n"
        "if __name__ == '__main__':\n"
        "    signal.signal(signal.SIGINT, lambda *_: None)\n"
        "    threading.Timer(0.05, os.killpg, (0, signal.SIGINT)).start()\n"
        "    print(sorted(run_all([1, 4], abs, local_workers(2), when_lost=str)))\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, start_new_session=True
    )
    assert (ran.stdout, ran.stderr) == ("[(1, 1), (4, 4)]\n", "")
