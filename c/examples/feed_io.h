/* What the replay needs of its surroundings: a file to read and lines to write. */

#ifndef FEED_IO_H
#define FEED_IO_H

#include <stdbool.h>
#include <stddef.h>

/* Fills `bytes` from the feed; false at its end. */
bool feed_read(void *bytes, size_t length);

/* Writes to the standard output. */
void text_write(const char *text, size_t length);

/* Deepest stack since the start, bytes; 0 where it is not measured. */
size_t stack_used(void);

/* Replays the feed; the exit code of the program. */
int replay(void);

#endif
