"""Observers of a running rig: data that the page's process collects beside the processes' reports.

========================  ==========================================================================================
observer                  line that it feeds
========================  ==========================================================================================
`lateness_floor`          page "the machine" (``floor``); /metrics ``trocar_machine_lateness_*``; `trocar latency`: "the
                          machine" on the time line and as a reason (its rings are written by `core_sleepers`, at
                          moments that `wakeup_phase` chooses)
`thread_usage`            page "wake-ups, switches, core, waited" of each process (``usage``); /metrics
                          ``trocar_context_switches``, ``trocar_processor_seconds``, ``trocar_waited_seconds``;
                          `trocar latency`: "who of the rig ran"
`incident_files`          page "last incident" (``flight``); `trocar latency` without a running rig, or with a FILE
========================  ==========================================================================================

Each is an `Observer`: it samples, and reports rows. The modules that the judging loop uses to detect hangs
(`loop_progress`, `runqueue_waits`, `scheduler_state`) decide and show nothing, so they are no observers.
"""
