# SPDX-FileCopyrightText: 2026 the maxcon authors
# SPDX-License-Identifier: MIT
"""Tasks have the same results wherever they are done, whoever ends meanwhile, and errors arrive in words."""

import os
import signal
import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from maxcon._system.engine import Engine, cluster
from maxcon._system.engine import crew as crew_module
from maxcon._system.engine.worker import Errand, Opening, close_jobs
from maxcon.errors import ArrayError, MissingExtraError, OptionError

if sys.platform == "win32":
    pytest.skip("no POSIX signals to kill a worker with", allow_module_level=True)

N_NUMBERS = 24
TASKS = [tuple(range(first, first + 3)) for first in range(0, N_NUMBERS, 3)]

needs_dask = pytest.mark.skipif(
    not all(map(__import__, ("distributed", "cryptography"))), reason="the extra engine is not installed"
)


@dataclass(frozen=True)
class Squares:
    """Squares of numbers; some end their worker, always or once, and some raise an error."""

    folder: Path
    deadly: tuple[int, ...] = ()
    wrong: tuple[int, ...] = ()
    name: str = "squares"

    def open(self):
        (self.folder / f"opened-{os.getpid()}-{time.monotonic_ns()}").touch()
        return self._squares

    def _squares(self, task):
        for number in task:
            if number in self.deadly:
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


@dataclass(frozen=True)
class Environment:
    """What the libraries of a worker are told of threads, and what it does with a signal of the terminal."""

    name: str = "environment"

    def open(self):
        return lambda task: (
            {name: os.environ.get(name) for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS")},
            signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ()),
        )

    def split(self, task):
        return [task]

    def lost(self, task, reason):
        raise AssertionError(reason)


def squares(engine, job):
    return dict(pair for _, pairs in engine.run(job, TASKS, len(TASKS)) for pair in pairs)


RIGHT = {number: number**2 for number in range(N_NUMBERS)}


def is_alive(pid):
    """A zombie that nobody waits for counts as ended."""
    import psutil

    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def all_ended(pids):
    deadline = time.monotonic() + 300.0
    while any(map(is_alive, pids)) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not any(map(is_alive, pids))


def test_one_worker_is_this_process(tmp_path):
    job = Squares(tmp_path)
    assert squares(Engine(1), job) == RIGHT
    assert job.processes() == [os.getpid()]


@needs_dask
def test_several_give_the_same_and_each_opens_once(tmp_path):
    job = Squares(tmp_path)
    assert squares(Engine(2), job) == RIGHT
    processes = job.processes()
    assert 1 <= len(processes) == len(set(processes)) <= 2
    assert os.getpid() not in processes
    assert all_ended(processes)


@needs_dask
def test_workers_use_one_thread_and_leave_the_terminal_to_the_caller():
    before = {name: value for name, value in os.environ.items() if "THREADS" in name}
    (found,) = {str(result) for _, result in Engine(2).run(Environment(), TASKS, len(TASKS))}
    assert found == str(({"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}, True))
    assert {name: value for name, value in os.environ.items() if "THREADS" in name} == before


@needs_dask
def test_a_worker_that_is_killed_loses_nothing(tmp_path):
    job, killed, found = Squares(tmp_path), 0, {}
    for _, pairs in Engine(2).run(job, TASKS, len(TASKS)):
        found.update(pairs)
        if killed < 2:
            victims = [pid for pid in job.processes() if is_alive(pid)]
            os.kill(victims[killed % len(victims)], signal.SIGKILL)
            killed += 1
    assert found == RIGHT
    assert len(job.processes()) > 2
    assert all_ended(job.processes())


@needs_dask
def test_what_ends_every_worker_is_told_from_its_neighbours(tmp_path):
    found = squares(Engine(2), Squares(tmp_path, deadly=(7,)))
    assert "each worker that was given it ended" in found.pop(7)
    assert found == {number: square for number, square in RIGHT.items() if number != 7}


@dataclass(frozen=True)
class Impatient:
    """Work that raises what dask raises while it waits."""

    name: str = "impatient"

    def open(self):
        def work(task):
            raise TimeoutError("the job's own")

        return work

    def split(self, task):
        return [task]

    def lost(self, task, reason):
        raise AssertionError(reason)


@needs_dask
def test_an_error_of_the_job_is_not_taken_for_a_slow_network():
    with pytest.raises(TimeoutError, match="the job's own"):
        list(Engine(2).run(Impatient(), TASKS, len(TASKS)))


@pytest.mark.parametrize("n_workers", [1, pytest.param(2, marks=needs_dask)])
def test_an_error_arrives_in_words_and_ends_all(tmp_path, n_workers):
    job = Squares(tmp_path, wrong=(10,))
    with pytest.raises(ArrayError, match="Expected another number, got 10"):
        squares(Engine(n_workers), job)
    assert all_ended(set(job.processes()) - {os.getpid()})


@needs_dask
def test_who_takes_no_more_results_lets_the_workers_go(tmp_path):
    job = Squares(tmp_path)
    results = Engine(2).run(job, TASKS, len(TASKS))
    next(results)
    results.close()
    assert all_ended(job.processes())


@needs_dask
def test_the_dashboard_is_named_where_it_is_served(tmp_path, monkeypatch):
    from urllib.request import urlopen

    lines, pages = [], []

    def tell(line):
        lines.append(line)
        with urlopen(line.split()[1], timeout=300) as page:
            pages.append(page.status)

    pytest.importorskip("bokeh")
    assert squares(Engine(2, tell=tell), Squares(tmp_path)) == RIGHT
    assert len(lines) == 1 and lines[0].startswith("dashboard    http://127.0.0.1:")
    assert pages == [200]
    monkeypatch.setattr("maxcon._system.engine.cluster.find_spec", lambda name: None if name == "bokeh" else name)
    assert squares(Engine(2, tell=tell), Squares(tmp_path)) == RIGHT
    assert len(lines) == 1


@needs_dask
def test_only_who_holds_the_certificate_is_listened_to(tmp_path, monkeypatch):
    """Any user of the machine reaches the ports; what comes through them is unpickled."""
    import dask.config
    from distributed import Client
    from distributed.security import Security

    seen = []
    results_of = crew_module.Crew.results

    def results(crew, tasks):
        address = crew._client.scheduler.address
        with dask.config.set({"distributed.comm.timeouts.connect": "3 s"}):
            for other in (address, address.replace("tls", "tcp")):
                credentials = Security.temporary() if other.startswith("tls") else None
                with pytest.raises((OSError, TimeoutError)):
                    Client(other, timeout=3, security=credentials, set_as_default=False)
                seen.append(other)
        yield from results_of(crew, tasks)

    monkeypatch.setattr(crew_module.Crew, "results", results)
    assert squares(Engine(2), Squares(tmp_path)) == RIGHT
    assert [address.startswith(("tls://127.0.0.1:", "tcp://127.0.0.1:")) for address in seen] == [True, True]


def test_a_job_is_opened_once_for_all_its_tasks_and_closed(tmp_path):
    job = Squares(tmp_path)
    opening = Opening("a word", job)
    for task in TASKS[:3]:
        Errand(Opening("a word", Squares(tmp_path)), task)()
        Errand(opening, task)()
    assert len(job.processes()) == 1
    close_jobs()
    Errand(opening, TASKS[0])()
    assert len(job.processes()) == 2
    close_jobs()


def test_a_worker_of_another_version_is_refused(tmp_path):
    with pytest.raises(OptionError, match=r"Expected workers with maxcon 0\.0\.0, as here, got one with"):
        Errand(Opening("another", Squares(tmp_path), "0.0.0"), TASKS[0])()


def test_options_that_contradict_each_other_are_refused():
    with pytest.raises(OptionError, match="Leave out --workers or --scheduler"):
        Engine(2, "tcp://127.0.0.1:8786")
    with pytest.raises(OptionError, match="at least one process, got 0"):
        Engine(0)


def test_without_dask_one_process_does_all(tmp_path, monkeypatch):
    monkeypatch.setattr("maxcon._system.engine.cluster.find_spec", lambda name: None)
    job = Squares(tmp_path)
    assert squares(Engine(), job) == RIGHT
    assert job.processes() == [os.getpid()]
    for options in ((2,), (None, "tcp://127.0.0.1:8786")):
        with pytest.raises(MissingExtraError, match=r"pip install 'maxcon\[engine\]'"):
            Engine(*options)


@needs_dask
def test_a_scheduler_that_is_not_there_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("maxcon._system.engine.cluster.JOIN_TIMEOUT", 1)
    monkeypatch.setattr("maxcon._system.engine.cluster.TOLD_AFTER", 0.0)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        silent, lines = f"tcp://127.0.0.1:{port}", []
        for address in ("nonsense://here", "tls://127.0.0.1:1", "tcp://a..b:8786", f"tcp://{'x' * 70}:1", silent):
            with pytest.raises(OptionError, match="Expected a dask scheduler at"):
                squares(Engine(scheduler=address, warn=lines.append), Squares(tmp_path))
    assert lines[-1] == f"waiting up to 1 s for a scheduler at {silent}"


@needs_dask
@pytest.mark.parametrize(
    "error", [ConnectionRefusedError(111, "Connection refused"), socket.gaierror(-2, "Name not known")]
)
def test_where_nobody_listens_dask_does_not_begin_to_wait(tmp_path, monkeypatch, error):
    def connected(address, timeout):
        raise error

    monkeypatch.setattr(cluster, "REFUSED_TIMEOUT", 0.1)
    monkeypatch.setattr(cluster, "_check_answers", None)
    monkeypatch.setattr(cluster.socket, "create_connection", connected)
    with pytest.raises(OptionError, match=rf"at tcp://host:1, got: {error.strerror}\. Start one"):
        squares(Engine(scheduler="tcp://host:1"), Squares(tmp_path))


@needs_dask
def test_a_scheduler_that_is_just_starting_is_waited_for(monkeypatch):
    """It refuses at first, and listens a moment later."""
    tries, connect = [], socket.create_connection

    def connected(address, timeout):
        tries.append(address)
        if len(tries) < 3:
            raise ConnectionRefusedError(111, "Connection refused")
        return connect(address, timeout)

    monkeypatch.setattr(cluster, "REFUSED_TIMEOUT", 600)
    monkeypatch.setattr(cluster, "JOIN_TIMEOUT", 600)
    monkeypatch.setattr(cluster.socket, "create_connection", connected)
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        place = listening.getsockname()
        cluster._check_listens(f"tcp://127.0.0.1:{place[1]}")
    assert tries == [place] * 3


@needs_dask
def test_a_scheduler_without_workers_is_refused(tmp_path, monkeypatch):
    from distributed import LocalCluster

    monkeypatch.setattr("maxcon._system.engine.cluster.JOIN_TIMEOUT", 2)
    monkeypatch.setattr("maxcon._system.engine.cluster.TOLD_AFTER", 0.0)
    lines = []
    with (
        LocalCluster(n_workers=0, host="127.0.0.1", dashboard_address="127.0.0.1:0") as empty,
        pytest.raises(OptionError, match=r"Expected workers at tcp.*but there is none after 2 s"),
    ):
        squares(Engine(scheduler=empty.scheduler_address, warn=lines.append), Squares(tmp_path))
    assert lines[-1] == f"waiting up to 2 s for a worker at {empty.scheduler_address}"


@needs_dask
def test_workers_that_go_and_do_not_come_back_are_said(tmp_path, monkeypatch):
    from distributed import LocalCluster

    from maxcon.errors import MaxconError

    monkeypatch.setattr(crew_module, "LONGEST_ALONE", 2.0)
    monkeypatch.setattr(crew_module, "FETCH_TIMEOUT", 2.0)
    with LocalCluster(1, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0") as cluster:
        results = Engine(scheduler=cluster.scheduler_address).run(Squares(tmp_path), TASKS, len(TASKS))
        next(results)
        cluster.scale(0)
        with pytest.raises(MaxconError, match=r"there has been none for 2 s\. What is done is kept"):
            list(results)


@needs_dask
def test_a_scheduler_that_goes_is_said(tmp_path):
    from distributed import LocalCluster

    from maxcon.errors import MaxconError

    with LocalCluster(1, threads_per_worker=1, host="127.0.0.1", dashboard_address="127.0.0.1:0") as cluster:
        results = Engine(scheduler=cluster.scheduler_address).run(Squares(tmp_path), TASKS, len(TASKS))
        next(results)
        cluster.close()
        with pytest.raises(MaxconError, match=r"but the scheduler is gone\. What is done is kept"):
            list(results)


@needs_dask
def test_a_script_that_its_workers_would_run_again_is_told_so(tmp_path):
    script = tmp_path / "script.py"
    body = "from maxcon._system.engine import Engine\nlist(Engine(2).run(None, [(0,)] * 9, 9))\n"
    script.write_text(body)
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=900)
    assert ended.returncode == 1
    last = ended.stderr.splitlines()[-1]
    assert "Expected 2 worker processes to start, got: Nanny failed to start. A script needs its last lines" in last


def test_loading_the_engine_loads_no_dask():
    loaded = "[n for n in ('dask', 'distributed', 'tornado') if n in sys.modules]"
    script = f"import sys, maxcon._system.engine; print({loaded})"
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ended.stdout == "[]\n"
