"""A process that does batches of a cohort, one after another, as another process tells it."""

import os
import pickle
import signal
import sys
import traceback


def main() -> None:
    """Read what is to be done, then batch after batch, until nobody writes any more."""
    # What is printed meanwhile must not get among the answers.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    # An interrupt is the business of the process that asked.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    questions = sys.stdin.buffer
    sys.path[:] = pickle.load(questions)
    work = pickle.load(questions)

    from pymc_hyperelastic.cohorts.work import Remarks, run_batch

    while True:
        try:
            batch = pickle.load(questions)
        except EOFError:
            return
        answer: Remarks | Exception
        try:
            answer = run_batch(work, "here", *batch)
        except Exception as error:
            error.add_note(traceback.format_exc())
            answer = error
        try:
            pickle.dump(answer, answers)
        except Exception:  # not every exception can be sent
            pickle.dump(RuntimeError(f"{type(answer).__name__}: {answer}"), answers)
        try:
            answers.flush()
        except BrokenPipeError:  # nobody asks any more, and nothing is left to be written
            os._exit(0)


if __name__ == "__main__":
    main()
