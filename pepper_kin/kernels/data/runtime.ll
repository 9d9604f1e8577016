declare i8* @malloc(i64)
declare i8* @aligned_alloc(i64, i64)
declare void @free(i8*)

define linkonce_odr i8* @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %more = add i64 %size, 191
  %rounded = and i64 %more, -64
  %info = call i8* @aligned_alloc(i64 64, i64 %rounded)
  %none = icmp eq i8* %info, null
  br i1 %none, label %out, label %fill
fill:
  %words = bitcast i8* %info to i64*
  store i64 1, i64* %words
  %data = getelementptr i8, i8* %info, i64 64
  %places = bitcast i8* %info to i8**
  %dtor = getelementptr i8*, i8** %places, i64 1
  store i8* null, i8** %dtor
  %third = getelementptr i8*, i8** %places, i64 3
  store i8* %data, i8** %third
  %fourth = getelementptr i64, i64* %words, i64 4
  store i64 %size, i64* %fourth
  ret i8* %info
out:
  ret i8* null
}
define linkonce_odr i8* @NRT_MemInfo_alloc_safe_aligned(i64 %size, i32 %align) {
  %info = call i8* @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align)
  ret i8* %info
}
define linkonce_odr i8* @NRT_MemInfo_alloc(i64 %size) {
  %info = call i8* @NRT_MemInfo_alloc_aligned(i64 %size, i32 64)
  ret i8* %info
}
define linkonce_odr i8* @NRT_Allocate(i64 %size) {
  %memory = call i8* @malloc(i64 %size)
  ret i8* %memory
}
define linkonce_odr void @NRT_Free(i8* %memory) {
  call void @free(i8* %memory)
  ret void
}
define linkonce_odr void @NRT_MemInfo_call_dtor(i8* %info) {
  call void @free(i8* %info)
  ret void
}
define linkonce_odr i64 @pk_contiguous(i64 %n, i64* %dims, i64* %strides, i64 %item, i1 %write) {
entry:
  br label %test
test:
  %i = phi i64 [ %n, %entry ], [ %k, %next ]
  %stride = phi i64 [ %item, %entry ], [ %longer, %next ]
  %more = icmp sgt i64 %i, 0
  br i1 %more, label %body, label %good
body:
  %k = sub i64 %i, 1
  %place = getelementptr i64, i64* %strides, i64 %k
  br i1 %write, label %store, label %compare
store:
  store i64 %stride, i64* %place
  br label %next
compare:
  %is = load i64, i64* %place
  %same = icmp eq i64 %is, %stride
  br i1 %same, label %next, label %bad
next:
  %length = getelementptr i64, i64* %dims, i64 %k
  %size = load i64, i64* %length
  %longer = mul i64 %stride, %size
  br label %test
good:
  ret i64 1
bad:
  ret i64 0
}
define linkonce_odr i32 @numba_attempt_nocopy_reshape(i64 %n, i64* %dims, i64* %strides, i64 %newn, i64*
%newdims,
                                                      i64* %newstrides, i64 %item, i32 %order) {
  %fine = call i64 @pk_contiguous(i64 %n, i64* %dims, i64* %strides, i64 %item, i1 0)
  %isfine = icmp eq i64 %fine, 1
  br i1 %isfine, label %write, label %out
write:
  %done = call i64 @pk_contiguous(i64 %newn, i64* %newdims, i64* %newstrides, i64 %item, i1 1)
  ret i32 1
out:
  ret i32 0
}
