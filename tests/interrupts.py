"""Interrupt a call of a function, as Ctrl-C does."""


def interrupt(monkeypatch, module, name, call):
    """Let the n-th call of a function raise KeyboardInterrupt."""
    function, calls = getattr(module, name), []

    def interrupted(*args, **kwargs):
        calls.append(1)
        if len(calls) == call:
            raise KeyboardInterrupt
        return function(*args, **kwargs)

    monkeypatch.setattr(module, name, interrupted)
