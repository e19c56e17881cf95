"""An interrupt at a chosen place, as by Ctrl-C."""


def interrupt(monkeypatch, module, name, call):
    """Make the n-th call of a function meet Ctrl-C."""
    function, calls = getattr(module, name), []

    def interrupted(*args, **kwargs):
        calls.append(1)
        if len(calls) == call:
            raise KeyboardInterrupt
        return function(*args, **kwargs)

    monkeypatch.setattr(module, name, interrupted)
