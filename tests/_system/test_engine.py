"""Tasks have the same results wherever they are done, whoever ends meanwhile, and errors arrive in words."""

import os
import signal
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from maxcon._system import cluster, engine
from maxcon._system.engine import Engine, Opening, close_jobs, do_task, in_order_of, ordered_map
from maxcon.errors import ArrayError, MaxconError, MissingExtraError, OptionError
from watched_processes import all_ended, is_alive

if sys.platform == "win32":
    pytest.skip("no POSIX signals to kill a worker with", allow_module_level=True)

N_NUMBERS = 24
TASKS = [tuple(range(first, first + 3)) for first in range(0, N_NUMBERS, 3)]
RIGHT = {number: number**2 for number in range(N_NUMBERS)}


@dataclass(frozen=True)
class Squares:
    """Squares of numbers; some end their worker, always or once, and some raise an error."""

    folder: Path
    deadly: tuple[int, ...] = ()
    wrong: tuple[int, ...] = ()

    def open(self):
        (self.folder / f"opened-{os.getpid()}-{time.monotonic_ns()}").touch()
        return self._squares

    def _squares(self, task):
        for number in task:
            if number in self.deadly:
                time.sleep(1.0)  # dask's nanny does not replace a worker that ends while it begins
                os.kill(os.getpid(), signal.SIGKILL)
            if number in self.wrong:
                raise ArrayError(f"Expected another number, got {number}. Take one.")
        time.sleep(0.05)
        return [(number, number**2) for number in task]

    def split(self, task):
        return [(number,) for number in task]

    def lost(self, task, reason):
        return [(number, reason) for number in task]

    def processes(self):
        """Processes that opened this job, one entry for each time."""
        return [int(path.name.split("-")[1]) for path in self.folder.glob("opened-*")]


def squares(where, job, n_kills=0):
    """What comes of the tasks, while so many workers are killed."""
    found = {}
    for _, pairs in where.run(job, TASKS, len(TASKS)):
        found.update(pairs)
        if n_kills and (victims := [pid for pid in job.processes() if is_alive(pid)]):
            os.kill(victims[n_kills % len(victims)], signal.SIGKILL)
            n_kills -= 1
    assert n_kills == 0
    return found


def test_one_worker_is_this_process(tmp_path):
    job = Squares(tmp_path)
    assert squares(Engine(1), job) == RIGHT and job.processes() == [os.getpid()]


def test_several_give_the_same_each_opens_once_and_may_be_left_at_any_moment(tmp_path):
    job = Squares(tmp_path)
    with Engine(2).started(len(TASKS)) as run:
        assert dict(pair for _, pairs in run(job, TASKS) for pair in pairs) == RIGHT
        processes = job.processes()
        assert 1 <= len(processes) == len(set(processes)) <= 2 and os.getpid() not in processes
        results = run(job, TASKS)
        next(results)
        results.close()
    assert all_ended(processes)


@pytest.mark.parametrize("n_workers", [1, 2])
def test_an_error_arrives_in_words_and_ends_all(tmp_path, n_workers):
    job = Squares(tmp_path, wrong=(10,))
    with pytest.raises(ArrayError, match="Expected another number, got 10"):
        squares(Engine(n_workers), job)
    assert all_ended(set(job.processes()) - {os.getpid()})


@pytest.mark.kills
def test_a_worker_that_is_killed_loses_nothing(tmp_path):
    job = Squares(tmp_path)
    assert squares(Engine(2), job, n_kills=3) == RIGHT and len(job.processes()) > 2
    assert all_ended(job.processes())


@pytest.mark.kills
def test_what_ends_every_worker_is_told_from_its_neighbours(tmp_path):
    found = squares(Engine(2), Squares(tmp_path, deadly=(7,)))
    assert "each worker that was given it ended" in found.pop(7)
    assert found == {number: square for number, square in RIGHT.items() if number != 7}


ENDED_WITH_PARENT = """
import os, signal, sys
from pathlib import Path
sys.path[:0] = {folders!r}
from test_engine import TASKS, Squares
from maxcon._system.engine import Engine

if __name__ == "__main__":
    job = Squares(Path(sys.argv[1]))
    next(Engine(2).run(job, TASKS, len(TASKS)))
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.kills
def test_workers_end_with_the_process_that_started_them(tmp_path):
    script, folder = tmp_path / "script.py", tmp_path / "opened"
    folder.mkdir()
    script.write_text(ENDED_WITH_PARENT.format(folders=[str(folder) for folder in Path(__file__).parents[:2]]))
    assert subprocess.run([sys.executable, script, folder], timeout=300).returncode == -signal.SIGKILL
    processes = Squares(folder).processes()
    assert processes and all_ended(processes)


@pytest.mark.kills
def test_a_script_that_its_workers_would_run_again_is_told_so(tmp_path):
    script = tmp_path / "script.py"
    script.write_text("from maxcon._system.engine import Engine\nlist(Engine(2).run(None, [(0,)] * 9, 9))\n")
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=900)
    assert ended.returncode == 1
    last = ended.stderr.splitlines()[-1]
    assert "Expected 2 worker processes to start, got: A" in last and "A script needs its last lines behind" in last


def test_a_job_is_opened_once_for_all_its_tasks_and_closed(tmp_path):
    job = Squares(tmp_path)
    opening = Opening("a word", job)
    for task in TASKS[:3]:
        do_task(Opening("a word", Squares(tmp_path)), task)
        do_task(opening, task)
    assert len(job.processes()) == 1
    close_jobs()
    do_task(opening, TASKS[0])
    assert len(job.processes()) == 2
    close_jobs()
    with pytest.raises(OptionError, match=r"Expected workers with maxcon 0\.0\.0, as here, got one with"):
        do_task(Opening("another", job, "0.0.0"), TASKS[0])


def test_options_that_contradict_each_other_are_refused(monkeypatch):
    for n_workers, scheduler in ((2, "tcp://127.0.0.1:8786"), (0, None)):
        with pytest.raises(OptionError, match="either at least one worker on this machine or the address"):
            Engine(n_workers, scheduler)
    monkeypatch.setattr(engine, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"pip install 'maxcon\[engine\]'"):
        Engine(None, "tcp://127.0.0.1:8786")


# --- in order ---
@given(st.permutations(range(12)))
def test_results_that_come_in_any_order_are_put_in_order_as_soon_as_they_can(order):
    asked = []

    def coming():
        for number in order:
            asked.append(number)
            yield number, number**2
        asked.append(None)

    for number, result in enumerate(in_order_of(range(12), coming())):
        assert result == number**2 and len(asked) == 1 + max(map(order.index, range(number + 1)))
    assert asked[-1] is None


@given(st.integers(0, 30), st.integers(1, 5), st.integers(1, 9))
def test_threads_yield_in_order_and_begin_no_more_than_they_may(n, n_threads, n_ahead):
    begun = []

    def work(number):
        begun.append(number)
        return -number

    with ThreadPoolExecutor(n_threads) as pool:
        for number, result in enumerate(ordered_map(pool, work, range(n), n_ahead)):
            assert result == -number and len(begun) <= number + n_ahead
    assert sorted(begun) == list(range(n))


# --- a cluster that somebody has started ---
@pytest.mark.clusters
def test_workers_of_a_cluster_do_the_same_and_are_left_as_they_were(tmp_path, dask):
    """Killed and wrong: two jobs, one after the other."""
    where = Engine(scheduler=dask(2).scheduler_address)
    assert squares(where, Squares(tmp_path), n_kills=1) == RIGHT  # the second might begin just now
    with pytest.raises(ArrayError, match="Expected another number, got 10"):
        squares(where, Squares(tmp_path, wrong=(10,)))


@pytest.mark.clusters
def test_a_scheduler_that_is_not_there_or_has_no_workers_is_refused(tmp_path, dask, monkeypatch):
    monkeypatch.setattr(cluster, "JOIN_TIMEOUT", 1)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        silent = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
        for address in ("nonsense://here", "tls://127.0.0.1:1", "tcp://a..b:8786", f"tcp://{'x' * 70}:1", silent):
            with pytest.raises(OptionError, match="Expected a dask scheduler with workers at"):
                squares(Engine(scheduler=address), Squares(tmp_path))
    empty, lines = dask(0).scheduler_address, []
    with pytest.raises(OptionError, match="Expected a dask scheduler with workers at tcp"):
        squares(Engine(scheduler=empty, warn=lines.append), Squares(tmp_path))
    assert lines == [f"waiting up to 1 s for a worker at {empty}"]


@pytest.mark.clusters
@pytest.mark.parametrize(("leave", "words"), [
    (lambda each: each.scale(0), "there has been none for 1 s"), (lambda each: each.close(), "the scheduler is gone"),
])  # fmt: skip
def test_workers_or_a_scheduler_that_go_are_said(tmp_path, dask, monkeypatch, leave, words):
    monkeypatch.setattr(cluster, "LONGEST_ALONE", 1.0)
    started = dask(1)
    results = Engine(scheduler=started.scheduler_address).run(Squares(tmp_path), TASKS, len(TASKS))
    next(results)
    leave(started)
    with pytest.raises(MaxconError, match=rf"{words}\. What is done is kept"):
        list(results)


def test_loading_the_engine_loads_no_dask():
    script = (
        "import sys, maxcon._system.engine; print([n for n in ('dask', 'distributed', 'msgspec') if n in sys.modules])"
    )
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ended.stdout == "[]\n"
