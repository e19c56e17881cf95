"""A worker process: it receives batches of a cohort from another process, and computes them."""

import os
import pickle
import signal
import sys
import traceback

from pymc_hyperelastic.cohorts.work import Remarks, run_batch


def main() -> None:
    """Read the work, then batch after batch, and answer each, until the input ends.

    The first answer says that the worker has started.
    """
    # Text that is printed must not get among the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    # The process that asks stops its workers after an interrupt.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    questions, work = sys.stdin.buffer, None
    while True:
        try:
            question = pickle.load(questions)
        except EOFError:
            return
        answer: Remarks | Exception
        try:
            if work is None:
                work, answer = pickle.loads(question), Remarks([], [])
            else:
                answer = run_batch(work, "here", *question)
        except Exception as error:
            error.add_note(traceback.format_exc())
            answer = error
        try:
            pickle.dump(answer, answers)
        except Exception:  # not every exception can be sent
            pickle.dump(RuntimeError(f"{type(answer).__name__}: {answer}"), answers)
        try:
            answers.flush()
        except BrokenPipeError:  # the process that asked has ended
            os._exit(0)
