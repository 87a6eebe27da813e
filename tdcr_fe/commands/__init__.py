"""The subcommands of `tdcr-fe`."""
