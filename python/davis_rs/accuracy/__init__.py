"""Measures what accuracy costs in time: the sweep, its settings, its report; hard cases against brute force.

``frame_rates`` -> ``frame_rate_report``; ``light_accuracy`` (what baking saves and errs); ``accuracy_sweep`` ->
``settings``, ``report``, ``reference_events``; ``hard_cases`` -> ``hard_case_scenes``, ``brute_force``.
"""
