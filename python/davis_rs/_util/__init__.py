"""Holds helpers that know nothing of cameras: arguments and their errors, whole files, progress.

- Arguments: ``argument_checks`` (numbers, sizes, kinds) raise ``argument_error``, which carries the names of
  arguments, so that the command line, plans and Python call them as their users do. ``close_names`` suggests what was
  meant; ``names_elsewhere`` knows the names of other simulators, ``former_names`` those that this project has changed.
- Files: ``whole_file`` (a file gets its name when it is whole), ``holding`` (locks of what is written), ``untrusted``
  (what may be opened, libraries' errors as DecodeError), ``budget`` (how much one source may take), ``yaml_file``
  (strict YAML).
- Long work: ``progress`` (all bars), ``read_ahead`` (prefetches in a background thread), ``stop_requests`` (Ctrl-C is
  deferred to a safe point), ``folder_report`` (what a run wrote), ``terminal_text`` (text that
  came from files is escaped).
- For people: ``quantities`` (times, rates and values with their units), ``html_table`` (what a notebook shows).
- ``memory_forecast``: how much a run will take, and what there is. ``random_words``: a draw is the SHA-256 of (seed,
  sequence, key), so that a new key changes no other draw.
  ``extras``: libraries that only some parts need. ``last_used``: results that a run needs several times.
  ``array_types``: names for arrays of any precision, and for values of JSON.

What is made at once gets its name when it is whole, in a hidden folder next to it. A writer of events gets its name
at once, because what was written must survive a kill.
"""
