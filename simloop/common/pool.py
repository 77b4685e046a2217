"""Run many independent work items on an executor: processes of this machine, or a cluster.

A few items are submitted at a time. Each result is returned as soon as it is ready. Worker
processes never outlive the process that has started them, however it ends.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    as_completed,
    wait,
)
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any, Generic, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

_ITEMS_PER_WORKER = 2  # submitted per worker: none waits for work, and a broken pool loses few
_CHECK_STOP_EVERY_S = 0.2  # longest wait between two calls of ``stop``
_END_WITHIN_S = 2.0  # a worker that has not ended by then, e.g. a suspended one, is killed
_PR_SET_PDEATHSIG = 1  # linux/prctl.h


@dataclass(frozen=True, slots=True)
class Workers:
    """Description of the workers that process the items.

    Attributes:
        make_pool: Makes the executor. It is called again if a worker died.
        count: Number of items that are processed at the same time.
        deaths: Exceptions that a future of the executor raises if its worker died.
    """

    make_pool: Callable[[], Executor]
    count: int
    deaths: tuple[type[BaseException], ...] = (BrokenExecutor,)


class WorkerPool(ProcessPoolExecutor):
    """Process pool whose workers can be ended at once.

    Each worker starts as a new interpreter. It ignores Ctrl-C, because the parent process decides
    when its workers end. It ends by itself if the parent process is gone.
    """

    def __init__(self, workers: int) -> None:
        """Prepare the pool. A worker process starts when there is work for it.

        Args:
            workers: Largest number of processes, at least 1.
        """
        self._context = _RecordingContext()
        super().__init__(workers, self._context, _become_worker, (os.getpid(),))

    def end_workers(self) -> None:
        """Cancel all work and end the processes of this pool, but no other process."""
        self.shutdown(wait=False, cancel_futures=True)
        alive = [process for process in self._context.started if process.is_alive()]
        for process in alive:
            process.terminate()
        for process in alive:
            process.join(_END_WITHIN_S)
            if process.is_alive():
                process.kill()


def processes(asked: int) -> int:
    """Choose the number of worker processes.

    Args:
        asked: The number that was asked for; 0: as many as cores.

    Returns:
        The number, at least 1.
    """
    return asked or os.cpu_count() or 1


def local_workers(count: int) -> Workers:
    """Describe worker processes on this machine.

    Args:
        count: Number of processes, at least 1.

    Returns:
        The workers. No process starts before there is work.
    """
    return Workers(lambda: WorkerPool(count), count)


def run_all(
    items: Sequence[Item],
    work: Callable[[Item], Result],
    workers: Workers,
    *,
    when_lost: Callable[[Item], Result],
    stop: Callable[[], bool] = lambda: False,
    finish_started: bool = True,
) -> Generator[tuple[Item, Result], None, None]:
    """Process all items and yield the results in the order in which they are finished.

    If a worker process dies, its pool breaks, and the unfinished items in that pool lose their
    results. Then a new pool is made, and these items are tried again one at a time. An item that
    breaks its pool again, while it is alone in it, is abandoned.

    If the caller stops iterating, or is interrupted, the workers of the pool are ended at once.

    Args:
        items: The work items. Each must be picklable if the workers are processes.
        work: The function that makes an item's result. Picklable like the items.
        workers: The workers that process the items.
        when_lost: Makes the result of an abandoned item, or raises.
        stop: Called several times a second. After it returns True no further item is started.
        finish_started: Whether items that a worker has started are finished after a stop.
            Otherwise the workers are ended at once.

    Yields:
        Pairs of an item and its result.

    Raises:
        Exception: Any exception of ``work`` or ``when_lost``. The remaining items are abandoned.
    """
    waiting, suspects = deque(items), deque[Item]()
    pool, alone = _Pool(work, workers), False
    try:
        while (waiting or suspects or pool.busy) and not stop():
            # Each suspect is alone in the pool until it is finished, the last one too.
            alone = bool(suspects) or (alone and pool.busy)
            if alone:
                pool.submit_from(suspects, 1)
            else:
                pool.submit_from(waiting, _ITEMS_PER_WORKER * workers.count)
            finished, lost = pool.collect()
            yield from finished
            if alone:
                yield from [(item, when_lost(item)) for item in lost]
            else:
                suspects.extend(lost)
        if pool.busy and not finish_started:
            pool.abandon()
            return
        yield from pool.finish()
    except BaseException:  # including GeneratorExit: the caller no longer needs the results
        pool.abandon()
        raise


class _Pool(Generic[Item, Result]):
    """Executor and its unfinished items. A broken executor is replaced by a new one."""

    def __init__(self, work: Callable[[Item], Result], workers: Workers) -> None:
        self._work, self._workers, self._deaths = work, workers, workers.deaths
        self._executor, self._broken = workers.make_pool(), False
        self._under_way: dict[Future[Result], Item] = {}

    @property
    def busy(self) -> bool:
        return bool(self._under_way)

    def submit_from(self, queue: deque[Item], most: int) -> None:
        """Submit items from the queue until ``most`` are unfinished."""
        while queue and len(self._under_way) < most:
            try:
                future = self._executor.submit(self._work, queue[0])
            except self._deaths:  # a worker died between two items
                self._broken = True
                return
            self._under_way[future] = queue.popleft()

    def collect(self) -> tuple[list[tuple[Item, Result]], list[Item]]:
        """Wait briefly; return the items with a result, and those that a broken executor lost."""
        done, _ = wait(self._under_way, _CHECK_STOP_EVERY_S, FIRST_COMPLETED)
        if self._broken or any(isinstance(f.exception(), self._deaths) for f in done):
            # A broken executor ends all its futures, so this wait returns.
            done, _ = wait(self._under_way)
            self._executor.shutdown(wait=False)
            self._executor, self._broken = self._workers.make_pool(), False
        finished: list[tuple[Item, Result]] = []
        lost: list[Item] = []
        for future in [future for future in self._under_way if future in done]:
            item = self._under_way.pop(future)
            try:
                finished.append((item, future.result()))
            except self._deaths:
                lost.append(item)
        return finished, lost

    def finish(self) -> Iterator[tuple[Item, Result]]:
        """Cancel the items not yet started, yield the other results, and end the executor."""
        for future in as_completed([one for one in self._under_way if not one.cancel()]):
            with suppress(*self._deaths):
                yield self._under_way[future], future.result()
        self._executor.shutdown(wait=True)

    def abandon(self) -> None:
        """Cancel all unfinished items."""
        for future in self._under_way:
            future.cancel()
        if isinstance(self._executor, WorkerPool):
            self._executor.end_workers()
        else:
            self._executor.shutdown(wait=False)


class _RecordingContext(SpawnContext):
    """Multiprocessing context ``spawn`` that remembers the processes it has started."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[SpawnProcess] = []

    def Process(self, *args: Any, **kwargs: Any) -> SpawnProcess:  # type: ignore[override]
        process = _DeafProcess(*args, **kwargs)
        self.started.append(process)
        return process


class _DeafProcess(SpawnProcess):
    """Process that does not hear Ctrl-C from its first instruction on.

    A terminal sends Ctrl-C to the workers too, but their parent must handle it. A worker that is
    still importing its modules would end in a traceback.
    """

    def start(self) -> None:
        if not hasattr(signal, "pthread_sigmask"):  # Windows
            super().start()
            return
        resource_tracker.ensure_running()  # it would unblock the signal again
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            super().start()  # the process inherits the blocked signal
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _become_worker(parent_pid: int) -> None:
    """Ignore Ctrl-C, and end this process when its parent process ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    if sys.platform == "linux":
        # The kernel ends the worker even while it computes in compiled code.
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL))
        if os.getppid() != parent_pid:  # the parent ended before the line above
            os._exit(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Wait until the parent process is gone, and end this process. This works on any system."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
