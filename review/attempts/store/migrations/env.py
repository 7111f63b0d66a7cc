"""How alembic reaches the store: over the connection that `trocar.review.attempts.store.attempts` hands it."""

from alembic import context

from trocar.review.attempts.store.tables import Base

connection = context.config.attributes["connection"]
context.configure(connection=connection, target_metadata=Base.metadata, render_as_batch=True)
with context.begin_transaction():
    context.run_migrations()
