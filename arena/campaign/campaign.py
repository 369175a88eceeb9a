"""Run of a whole campaign: flies all missing flights, records each result, and writes table and plots."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os.path import normpath
from pathlib import Path
from typing import Protocol

from arena.campaign.design import Flight
from arena.campaign.inputs import FileWatch, changed
from arena.campaign.report import in_campaign
from arena.campaign.runner import OnRecord
from arena.campaign.store import Listing, Record, Store
from arena.campaign.table import write_all
from arena.errors import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK, InputError


class FlyAll(Protocol):
    """Function that flies several flights of a campaign, such as `runner.fly_all`."""

    def __call__(
        self, flights: Sequence[Flight], folder: Path, *, on_record: OnRecord, on_poll: Callable[[], None]
    ) -> None: ...


class Progress(Protocol):
    """Display of the progress of a campaign."""

    def begin(self, total: int, flown: int, failed: int) -> None:
        """Show the total number of flights, how many already have a result, and how many of these have failed."""

    def add(self, record: Record) -> None:
        """Show the result of one flight."""

    def refresh(self) -> None:
        """Draw the progress display again. This method is called several times per second."""


@dataclass(frozen=True, kw_only=True)
class Finished:
    """Result of `fly_campaign`: records of the flights, paths of the table and plots, and exit code.

    records: all flights with a result, in the order of the list of flights
    """

    records: Sequence[Record]
    files: Sequence[Path]
    exit_code: int


def fly_campaign(
    store: Store,
    listing: Listing,
    flights: Sequence[Flight],
    fly_all: FlyAll,
    progress: Progress,
    *,
    retry_failed: bool = False,
) -> Finished:
    """Fly the flights of a campaign that have no result yet, and write the table and plots of all results.

    retry_failed: also fly the flights again that have failed.
    Ctrl-C ends the flights in the air; the results so far are kept, and the exit code is 130.
    Raises InputError if the folder belongs to other files, or if a file of the campaign is changed while it flies. Raises RunError if
    another campaign flies in the folder, or if the folder cannot be written.
    """
    interrupted, failure = False, None
    watch = FileWatch(listing.inputs, Path(listing.sweep).parent)
    with store.locked():
        _refuse_other(store, listing)
        store.write_listing(listing)
        done = {r.id: r for r in store.records().values() if not r.lost and (r.passed or not retry_failed)}
        missing = [flight for flight in flights if flight.id not in done]
        failed = sum(not done[flight.id].passed for flight in flights if flight.id in done)
        progress.begin(len(flights), len(flights) - len(missing), failed)
        with store.appending() as results:

            def note(record: Record) -> None:
                if edited := watch.changed():  # what this flight has flown is not known
                    raise InputError(
                        f"{', '.join(edited)}: changed while the campaign flew, so the flights in the air get no result. The results "
                        f"before the change are in {store.folder}. Undo the change, or choose another folder with --results"
                    )
                results.append(record)
                progress.add(record)

            try:
                fly_all(missing, store.folder, on_record=note, on_poll=progress.refresh)
            except KeyboardInterrupt:
                interrupted = True
            except InputError as error:
                failure = error
        records = in_campaign(listing, store.records().values())
        files = write_all(listing, records, store.folder)
    if failure is not None:
        raise failure
    passed = len(records) == len(flights) and all(r.passed for r in records)
    code = EXIT_INTERRUPTED if interrupted else EXIT_OK if passed else EXIT_FAILED
    return Finished(records=records, files=files, exit_code=code)


def _refuse_other(store: Store, listing: Listing) -> None:
    """Raise InputError if the folder has results that cannot be compared with new flights.

    They are results of another campaign, or of this campaign before one of its files was changed.
    """
    before = store.listing()
    if before is None or not store.records():
        return
    if before.flown and normpath(before.flown) != normpath(listing.flown):
        raise InputError(
            f"{store.folder}: already has the results of {before.flown}, not of {listing.flown}. Choose another folder with --results"
        )
    if (before.name, before.kind) != (listing.name, listing.kind):
        raise InputError(
            f"{store.folder}: already has the results of another campaign: {before.name!r} ({before.kind}), not {listing.name!r} "
            f"({listing.kind}). Choose another folder with --results"
        )
    if files := changed(before.inputs, listing.inputs):
        raise InputError(
            f"{store.folder}: {', '.join(files)} changed since the first flights, so new flights cannot be compared with "
            "them. Choose another folder with --results, or delete this folder"
        )
