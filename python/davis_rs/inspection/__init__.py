"""Looks back at datasets: checks, comparisons, summaries, pictures.

``check``, ``summary``, ``video``, ``event_image``, ``dataset_picture``, ``rerun_recording`` -> ``figure`` ->
``truth_panels`` -> ``flow_picture``;
``html_page`` (a page for browsers; its program is in ``web``); all -> ``visual_sequence`` (what is drawn of a
folder, an event file or a recording) -> ``dataset_description``. ``live_view`` shows events while they come;
``path_returns`` is for ``summary``. ``plan_folder`` sums up what ``generate`` made.
``statistics`` measures streams and compares them.
"""
