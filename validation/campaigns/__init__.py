"""All campaigns, a module each; `tdcr_fe.validation.runner` runs them."""
