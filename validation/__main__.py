"""The command ``python -m tdcr_fe.validation``: runs campaigns."""

from tdcr_fe.validation.runner import main

if __name__ == "__main__":
    raise SystemExit(main())
